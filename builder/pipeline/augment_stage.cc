#include "builder/pipeline/augment_stage.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <set>

#include "builder/pipeline/placement.h"
#include "builder/pipeline/source_cache.h"
#include "common/base/cancel.h"
#include "common/base/log.h"
#include "common/base/progress.h"
#include "common/io/atomic_file.h"
#include "common/io/sha256.h"

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

std::string KeyOf(const Neighbourhood& around, const std::vector<ExtractedPanorama>& panoramas,
                  const Rectifier& rectifier, const StationExtractOptions& options) {
  Sha256 hash;
  hash.Update(Format("augment %d\n", kAugmentVersion));
  const RenderOptions& r = options.render;
  hash.Update(Format("%.17g %.17g %.17g %.17g %d %.17g %d %.17g\n", r.max_stretch, r.good_stretch,
                     r.max_incidence_deg, r.max_range_m, options.max_sift, options.max_distance_m,
                     options.max_sources, options.min_coverage));
  hash.Update(ToCameraYaml(rectifier.camera(), "view"));
  for (const Station& s : around.stations) {
    hash.Update(Format("%.6f %.6f %.6f\n", s.position_in_pano.x(), s.position_in_pano.y(),
                       s.position_in_pano.z()));
  }
  for (std::size_t i = 0; i < around.members.size(); ++i) {
    const Rigid3& pose = around.placed[i].map_from_pano;
    // The content key holds the extraction's options too.
    hash.Update(panoramas[around.members[i]].content_key +
                Format(" %.6f %.6f %.6f %.9f %.9f %.9f %.9f\n", pose.translation.x(),
                       pose.translation.y(), pose.translation.z(), pose.rotation.x(),
                       pose.rotation.y(), pose.rotation.z(), pose.rotation.w()));
  }
  return hash.FinishHex();
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
                                const Rectifier& rectifier, const StationOptions& station_options,
                                const StationExtractOptions& options, const fs::path& work) {
  AugmentStageResult result;
  result.stations.resize(panoramas.size());
  result.files.resize(panoramas.size());
  for (std::uint32_t p = 0; p < panoramas.size(); ++p)
    result.stations[p] = {{p, Eigen::Vector3d::Zero()}};
  if (station_options.spacing_m <= 0 || panoramas.empty()) return result;

  const fs::path folder = work / "stations";
  ThrowIfError(MakeDirectories(folder, "--work"));
  const auto links = LinksOf(panoramas);
  SourceCache cache(rectifier.camera());
  std::vector<char> reused(panoramas.size(), 0);
  Progress progress("augment", static_cast<std::int64_t>(panoramas.size()), "panoramas");
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(0, panoramas.size(), 1),
      [&](const auto& range) {
        for (std::size_t p = range.begin(); p < range.end(); ++p) {
          if (CancelRequested()) return;
          Neighbourhood around =
              NeighbourhoodOf(static_cast<std::uint32_t>(p), panoramas, links, station_options);
          for (Station& s : around.stations) s.panorama_idx = static_cast<std::uint32_t>(p);
          result.stations[p] = around.stations;
          if (around.stations.size() > 1) {
            result.files[p] = folder / (KeyOf(around, panoramas, rectifier, options) + ".h5");
            reused[p] = fs::exists(result.files[p]) && ReadPanoramaFeatures(result.files[p]).ok();
            if (!reused[p]) {
              const std::vector<Station> rendered(around.stations.begin() + 1,
                                                  around.stations.end());
              WritePanoramaFeatures(
                  result.files[p],
                  ExtractStations(rendered, SourcesOf(around, panoramas, options, &cache),
                                  rectifier.camera(), rectifier.directions(), options));
            }
          }
          progress.Add();
        }
      },
      tbb::simple_partitioner());
  progress.Finish();
  StopIfCancelled();
  for (std::size_t p = 0; p < panoramas.size(); ++p) {
    result.num_stations += result.stations[p].size() - 1;
    result.num_reused += reused[p] != 0 ? 1 : 0;
  }
  return result;
}

}  // namespace panofix
