#include "builder/pipeline/augment_stage.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <set>

#include "builder/pipeline/attempt.h"
#include "builder/pipeline/placement.h"
#include "builder/pipeline/source_cache.h"
#include "common/base/cancel.h"
#include "common/base/log.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

// Raised whenever rendering gives other features for the same input.
constexpr int kAugmentVersion = 1;
constexpr int kSourceHops = 2;  // sources of a panorama's stations, along the links

// A panorama with those around it, placed in a frame of its own: what is planned and rendered here
// does not depend on the rest of the data set.
struct Neighbourhood {
  std::vector<std::uint32_t> members;  // into the data set; itself first, then by hops and order
  std::vector<MapPanorama> placed;     // of the members
  std::vector<Station> stations;       // the panorama itself first
};

std::vector<std::vector<std::uint32_t>> LinksOf(const std::vector<ExtractedPanorama>& panoramas) {
  std::vector<PanoramaRecord> records;
  for (const ExtractedPanorama& p : panoramas) records.push_back(p.record);
  std::vector<std::vector<std::uint32_t>> links;
  // Any frame will do: only the links are wanted.
  for (MapPanorama& p : PlacePanoramas(records, MapFrame::Tangent(records.front().position)))
    links.push_back(std::move(p.links));
  return links;
}

Neighbourhood NeighbourhoodOf(std::uint32_t centre, const std::vector<ExtractedPanorama>& panoramas,
                              const std::vector<std::vector<std::uint32_t>>& links,
                              const StationOptions& options) {
  Neighbourhood result;
  std::set<std::uint32_t> seen = {centre};
  result.members = {centre};
  std::size_t begin = 0;
  for (int hop = 0; hop < kSourceHops; ++hop) {
    const std::size_t end = result.members.size();
    for (; begin < end; ++begin) {
      for (const std::uint32_t next : links[result.members[begin]]) {
        if (seen.insert(next).second) result.members.push_back(next);
      }
    }
  }
  std::vector<PanoramaRecord> records;
  for (const std::uint32_t member : result.members) records.push_back(panoramas[member].record);
  result.placed = PlacePanoramas(records, MapFrame::Tangent(records.front().position));
  result.stations = PlanStations(result.placed, options).front();
  return result;
}

KeyParts KeyOf(const Neighbourhood& around, const std::vector<ExtractedPanorama>& panoramas,
               const Rectifier& rectifier, const StationExtractOptions& options) {
  KeyParts key;
  key.Add("program", Format("augment %d", kAugmentVersion));
  const RenderOptions& r = options.render;
  key.Add("options", Format("%.17g %.17g %.17g %.17g %d %.17g %d %.17g\n", r.max_stretch,
                            r.good_stretch, r.max_incidence_deg, r.max_range_m, options.max_sift,
                            options.max_distance_m, options.max_sources, options.min_coverage));
  std::string views = ToCameraYaml(rectifier.camera(), "view");
  for (const ViewDirection& d : rectifier.directions())
    views += Format("%.17g %.17g\n", d.yaw_deg, d.pitch_deg);
  key.Add("camera and views", views);
  std::string stations;
  for (const Station& s : around.stations) {
    stations += Format("%.6f %.6f %.6f\n", s.position_in_pano.x(), s.position_in_pano.y(),
                       s.position_in_pano.z());
  }
  key.Add("stations", stations);
  for (std::size_t i = 0; i < around.members.size(); ++i) {
    const Rigid3& pose = around.placed[i].map_from_pano;
    const ExtractedPanorama& member = panoramas[around.members[i]];
    // The content key holds the extraction's options too. Ranks are part of it: of equally near
    // sources the first is taken.
    key.AddPanorama(member.record.id, Format("%zu ", i) + member.content_key);
    key.AddPlace(member.record.id,
                 Format("%.6f %.6f %.6f %.9f %.9f %.9f %.9f", pose.translation.x(),
                        pose.translation.y(), pose.translation.z(), pose.rotation.x(),
                        pose.rotation.y(), pose.rotation.z(), pose.rotation.w()));
  }
  return key;
}

std::vector<StationSource> SourcesOf(const Neighbourhood& around,
                                     const std::vector<ExtractedPanorama>& panoramas,
                                     const StationExtractOptions& options, SourceCache* cache) {
  const LocalFrame local = LocalFrame::At(around.placed.front());
  const Rigid3 owner_from_local = local.LocalFromPano(around.placed.front()).Inverse();
  std::vector<StationSource> sources;
  for (std::size_t i = 0; i < around.members.size() && sources.size() < 255; ++i) {
    const ExtractedPanorama& panorama = panoramas[around.members[i]];
    const Rigid3 owner_from_source = owner_from_local * local.LocalFromPano(around.placed[i]);
    const bool in_reach =
        std::any_of(around.stations.begin() + 1, around.stations.end(), [&](const Station& s) {
          return (owner_from_source.translation - s.position_in_pano).norm() <=
                 options.max_distance_m;
        });
    if (!panorama.has_depth || !in_reach) continue;
    auto content = cache->Get(around.members[i], panorama.record);
    if (content) sources.push_back({panorama.record.id, std::move(content), owner_from_source});
  }
  return sources;
}

}  // namespace

AugmentStageResult AugmentStage(const std::vector<ExtractedPanorama>& panoramas,
                                const std::vector<std::uint32_t>& own, const Rectifier& rectifier,
                                const StationOptions& station_options,
                                const StationExtractOptions& options, const WorkFolder& work,
                                Progress* progress) {
  AugmentStageResult result;
  result.stations.resize(own.size());
  result.keys.resize(own.size());
  result.parts.resize(own.size());
  for (std::size_t i = 0; i < own.size(); ++i)
    result.stations[i] = {{own[i], Eigen::Vector3d::Zero()}};
  if (station_options.spacing_m <= 0 || own.empty()) return result;

  const auto links = LinksOf(panoramas);
  SourceCache cache(rectifier.camera());
  std::vector<std::uint64_t> num_bytes(own.size(), 0);
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(0, own.size(), 1),
      [&](const auto& range) {
        for (std::size_t i = range.begin(); i < range.end(); ++i) {
          if (CancelRequested()) return;
          Neighbourhood around = NeighbourhoodOf(own[i], panoramas, links, station_options);
          for (Station& s : around.stations) s.panorama_idx = own[i];
          result.stations[i] = around.stations;
          if (around.stations.size() > 1) {
            const KeyParts key = KeyOf(around, panoramas, rectifier, options);
            result.keys[i] = key.Hex();
            result.parts[i] = key.digests();
            const fs::path file = work.Content("stations", result.keys[i]);
            if (!fs::exists(file) || !ReadPanoramaFeatures(file).ok()) {
              const std::string& id = panoramas[own[i]].record.id;
              const Attempt attempt(work, Stage::kAugment, id, result.keys[i]);
              if (attempt.IsHopeless())
                throw Error(ErrorCode::kBadData, "stations of " + id + ": " + attempt.Reason());
              const std::vector<Station> rendered(around.stations.begin() + 1,
                                                  around.stations.end());
              WritePanoramaFeatures(
                  file, ExtractStations(rendered, SourcesOf(around, panoramas, options, &cache),
                                        rectifier.camera(), rectifier.directions(), options));
              num_bytes[i] = fs::file_size(file);
            }
          }
          if (progress != nullptr) progress->Add();
        }
      },
      tbb::simple_partitioner());
  StopIfCancelled();
  for (std::size_t i = 0; i < own.size(); ++i) {
    if (num_bytes[i] > 0) result.made.push_back(static_cast<std::uint32_t>(i));
    result.num_bytes_written += num_bytes[i];
  }
  return result;
}

}  // namespace panofix
