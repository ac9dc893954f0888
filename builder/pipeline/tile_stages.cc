// Stages over a tile: landmarks and similarity. What a tile becomes depends on its surroundings
// only: places are taken in a frame of its own, so that the data set's extent changes nothing.
#include <tbb/parallel_for.h>

#include <fstream>
#include <set>
#include <sstream>
#include <unordered_map>

#include "builder/pipeline/landmark_stage.h"
#include "builder/pipeline/placement.h"
#include "builder/pipeline/similarity_file.h"
#include "builder/pipeline/stages.h"
#include "builder/pipeline/view_images.h"
#include "builder/pipeline/vocabulary_stage.h"
#include "common/base/log.h"
#include "common/io/atomic_file.h"
#include "common/io/sha256.h"

namespace panofix::stages {
namespace {

namespace fs = std::filesystem;

// Raised whenever equal inputs give another tile, or other similarity rows.
constexpr int kLandmarksVersion = 2, kSimilarityVersion = 1;

// A tile's panoramas among those around it, placed, with what was made of each.
struct TileRegion {
  Region region;
  MapFrame frame;
  BundleContent content;                              // panoramas of the region and their stations
  std::vector<std::string> station_keys, words_keys;  // of each panorama; words where wanted
  std::size_t begin = 0, end = 0;                     // the tile's own
};

std::unordered_map<std::string, std::uint32_t> IndexOfIds(const Region& region) {
  std::unordered_map<std::string, std::uint32_t> index_of;
  for (std::uint32_t i = 0; i < region.panoramas.size(); ++i)
    index_of[region.panoramas[i].record.id] = i;
  return index_of;
}

void ReadStations(const BuildContext& context, const std::vector<std::string>& shards,
                  TileRegion* t) {
  const auto index_of = IndexOfIds(t->region);
  std::vector<std::vector<std::array<double, 3>>> stations(t->region.panoramas.size());
  t->station_keys.resize(stations.size());
  for (const std::string& shard : shards) {
    const auto receipt =
        ReadReceipt<AugmentReceipt>(context.work, Stage::kAugment, shard, &t->region.made_from);
    for (const AugmentReceipt::Panorama& p : receipt.panoramas) {
      const auto found = index_of.find(p.made.id);
      if (found == index_of.end()) continue;  // of an earlier plan; found out when assembled
      stations[found->second] = p.stations;
      t->station_keys[found->second] = p.made.key;
    }
  }
  for (std::uint32_t p = 0; p < stations.size(); ++p) {
    for (const auto& at : stations[p])
      t->content.stations.push_back({p, Eigen::Vector3d(at[0], at[1], at[2])});
  }
}

void ReadWordsKeys(const BuildContext& context, const std::set<std::string>& shards,
                   TileRegion* t) {
  const auto index_of = IndexOfIds(t->region);
  t->words_keys.resize(t->region.panoramas.size());
  for (const std::string& shard : shards) {
    const auto receipt =
        ReadReceipt<WordsReceipt>(context.work, Stage::kWords, shard, &t->region.made_from);
    for (const MadeFile& p : receipt.panoramas) {
      const auto found = index_of.find(p.id);
      if (found != index_of.end()) t->words_keys[found->second] = p.key;
    }
  }
}

TileRegion ReadTileRegion(const BuildContext& context, const std::string& tile) {
  Region region = ReadRegion(context, ShardsOf(context.plan, tile));
  const std::vector<std::uint32_t> own = region.OfTile(tile);
  const Geodetic origin = own.empty() ? Geodetic{} : region.panoramas[own.front()].record.position;
  TileRegion t{std::move(region), MapFrame::Tangent(origin), {}, {}, {}, 0, 0};
  if (own.empty()) return t;
  t.begin = own.front(), t.end = own.back() + std::size_t{1};
  std::vector<PanoramaRecord> records;
  for (const ExtractedPanorama& p : t.region.panoramas) records.push_back(p.record);
  t.content.panoramas = PlacePanoramas(records, t.frame);
  for (std::size_t i = 0; i < records.size(); ++i)
    t.content.panoramas[i].has_depth = t.region.panoramas[i].has_depth;
  t.content.directions = context.rectifier.directions();
  t.content.pack_descriptors = context.plan.options.pack_descriptors;
  return t;
}

std::string PoseText(const MapPanorama& p) {
  const Eigen::Vector3d& t = p.map_from_pano.translation;
  const Eigen::Quaterniond& q = p.map_from_pano.rotation;
  return Format("%.17g %.17g %.17g %.17g %.17g %.17g %.17g", t.x(), t.y(), t.z(), q.x(), q.y(),
                q.z(), q.w());
}

KeyParts TileKey(const BuildContext& context, const TileRegion& t,
                 const std::string& vocabulary_sha256) {
  const BuildOptions& o = context.plan.options;
  const LandmarkOptions& l = o.landmarks;
  const MapErrors& e = o.extract.errors;
  KeyParts key;
  key.Add("program", Format("landmarks %d", kLandmarksVersion));
  key.Add("options",
          Format("%d %d %.17g %d %.17g %.17g %d %d %d\n", l.merge ? 1 : 0, l.refine ? 1 : 0,
                 l.max_merge_descriptor_distance, l.max_per_view, l.max_shift_m, l.max_turn_deg,
                 o.pack_descriptors ? 1 : 0, o.keep_view_images ? 1 : 0, o.max_words) +
              Format("%.17g %.17g %.17g %.17g %.17g", e.range_sigma_share, e.normal_sigma_deg,
                     e.relief_sigma_m, e.panorama_position_sigma_m, e.panorama_heading_sigma_deg));
  key.Add("camera", ToCameraYaml(context.rectifier.camera(), "view"));
  key.Add("vocabulary", vocabulary_sha256);
  const std::vector<std::uint32_t> members =
      TileMembers(t.content.panoramas, t.begin, t.end, kLandmarkHalo_m);
  for (std::size_t i = 0; i < members.size(); ++i) {
    const std::uint32_t m = members[i];
    const bool is_own = m >= t.begin && m < t.end;
    const ExtractedPanorama& p = t.region.panoramas[m];
    key.AddPanorama(p.record.id, (is_own ? "own " : "halo ") + p.content_key + " " +
                                     t.station_keys[m] + " " +
                                     (is_own ? t.words_keys[m] : std::string()));
    key.AddPlace(p.record.id, PoseText(t.content.panoramas[m]));
  }
  return key;
}

PanoramaFeatures ReadFeatures(const BuildContext& context, const char* kind,
                              const std::string& key) {
  if (key.empty()) return {};
  auto features = ReadPanoramaFeatures(context.work.Content(kind, key));
  if (!features.ok()) throw Error(ErrorCode::kTryAgain, features.status().message());
  return std::move(features).value();
}

std::vector<ViewWords> ReadWordsOf(const BuildContext& context, const std::string& key) {
  auto words = ReadWords(context.work.Content("words", key));
  if (!words.ok()) throw Error(ErrorCode::kTryAgain, words.status().message());
  return std::move(words).value();
}

PartFile Describe(const fs::path& path) {
  return {static_cast<std::uint64_t>(fs::file_size(path)), ValueOrThrow(Sha256OfFile(path))};
}

bool Holds(const fs::path& path, const PartFile& part) {
  if (part.num_bytes == 0) return true;
  const auto sha256 = Sha256OfFile(path);
  return sha256.ok() && *sha256 == part.sha256;
}

RefinedPose InWgs84(const MapFrame& frame, const MapPanorama& panorama,
                    const RefinementReport& report) {
  RefinedPose refined;
  refined.report = report;
  refined.is_moved = report.shift_m > 0 || report.turn_deg > 0;
  if (!refined.is_moved) return refined;
  const Geodetic at = frame.ToGeodetic(panorama.map_from_pano.translation);
  const Eigen::Quaterniond q(frame.MapFromEnu(at).transpose() *
                             panorama.map_from_pano.rotation.toRotationMatrix());
  refined.geodetic = {at.lat_deg, at.lon_deg, at.height_m};
  refined.enu_from_pano = {q.x(), q.y(), q.z(), q.w()};
  return refined;
}

TileReceipt MakeTile(const BuildContext& context, const TileRegion& t, const std::string& key) {
  const BuildOptions& o = context.plan.options;
  const LandmarkStageInput input{
      [&](std::size_t p) {
        return ReadFeatures(context, "features", t.region.panoramas[p].content_key);
      },
      [&](std::size_t p) { return ReadFeatures(context, "stations", t.station_keys[p]); },
      t.content,
      o.extract.errors,
      context.rectifier.camera(),
      o.landmarks};
  std::vector<MapPanorama> panoramas = t.content.panoramas;
  std::vector<RefinementReport> refined;
  BundleTile tile = MakeLandmarkTile(input, t.begin, t.end, &panoramas, &refined);
  for (std::size_t p = t.begin; p < t.end; ++p) {
    for (const ViewWords& words : ReadWordsOf(context, t.words_keys[p]))
      tile.bags.push_back(MakeBag(words, t.content.vocabulary, o.max_words));
  }
  TileReceipt result;
  result.key = key;
  result.num_landmarks = static_cast<std::int64_t>(tile.landmarks.size());
  for (std::size_t i = 0; i < refined.size(); ++i)
    result.refined.push_back(InWgs84(t.frame, panoramas[t.begin + i], refined[i]));
  const fs::path file = context.work.Content("tiles", key);
  WriteTile(file, t.content, t.begin, t.end, tile);
  result.tile = Describe(file);
  if (o.keep_view_images) {
    tile.view_images =
        EncodeViewImages(std::span(t.region.panoramas).subspan(t.begin, t.end - t.begin),
                         context.rectifier, o.extract.features);
    const fs::path images = context.work.Content("images", key);
    WriteViewImages(images, t.content, t.begin, t.end, tile);
    result.images = Describe(images);
  }
  return result;
}

// What an earlier run made of the very same, whatever its receipt has become.
std::optional<TileReceipt> FindTile(const BuildContext& context, const std::string& key) {
  std::ifstream file(context.work.Content("tiles", key, ".json"));
  std::ostringstream text;
  if (!file || !(text << file.rdbuf())) return std::nullopt;
  auto tile = ParseTile(text.str());
  if (!tile || tile->key != key || !Holds(context.work.Content("tiles", key), tile->tile) ||
      !Holds(context.work.Content("images", key), tile->images)) {
    return std::nullopt;
  }
  return tile;
}

}  // namespace

UnitReport Landmarks(const BuildContext& context, const std::string& tile, Progress* progress) {
  TileRegion t = ReadTileRegion(context, tile);
  UnitReport report;
  report.num_items = 1;
  TileReceipt receipt;
  if (t.begin != t.end) {
    ReadStations(context, ShardsOf(context.plan, tile), &t);
    ReadWordsKeys(context,
                  {t.region.shard.begin() + static_cast<std::ptrdiff_t>(t.begin),
                   t.region.shard.begin() + static_cast<std::ptrdiff_t>(t.end)},
                  &t);
    FileReceipt weighed;
    t.content.vocabulary = ReadBuildVocabulary(context, &weighed, &t.region.made_from);
    const KeyParts key = TileKey(context, t, weighed.parts.at("file"));
    if (auto there = FindTile(context, key.Hex())) {
      receipt = std::move(*there);
    } else {
      const auto before = FindReceipt<TileReceipt>(context.work, Stage::kLandmarks, tile);
      receipt = MakeTile(context, t, key.Hex());
      report.AddRedone(tile, before ? &before->parts : nullptr, key.digests());
      report.num_bytes_written = receipt.tile.num_bytes + receipt.images.num_bytes;
      ThrowIfError(WriteFileAtomically(context.work.Content("tiles", key.Hex(), ".json"),
                                       FormatTile(receipt)));
    }
    receipt.parts = key.digests();
    if (progress != nullptr) progress->Add(static_cast<std::int64_t>(t.end - t.begin));
  }
  receipt.made_from = t.region.made_from;
  WriteReceipt(context.work, Stage::kLandmarks, tile, receipt);
  return report;
}

UnitReport Similarity(const BuildContext& context, const std::string& tile) {
  TileRegion t = ReadTileRegion(context, tile);
  const SimilarityOptions& options = context.plan.options.similarity;
  UnitReport report;
  report.num_items = 1;
  FileReceipt receipt;
  if (t.begin != t.end) {
    const auto& shards = ShardsOf(context.plan, tile);
    ReadWordsKeys(context, {shards.begin(), shards.end()}, &t);
    FileReceipt weighed;
    const Vocabulary vocabulary = ReadBuildVocabulary(context, &weighed, &t.region.made_from);
    std::vector<std::vector<std::uint32_t>> links;
    std::vector<std::array<double, 3>> positions;
    for (const MapPanorama& p : t.content.panoramas) {
      links.push_back(p.links);
      const Eigen::Vector3d& at = p.map_from_pano.translation;
      positions.push_back({at.x(), at.y(), at.z()});
    }
    const auto neighbourhoods =
        AppearanceNeighbourhoods(links, positions, context.plan.options.num_views, options);
    std::set<std::uint32_t> needed;
    std::string who_sees_whom;
    for (std::size_t p = t.begin; p < t.end; ++p) {
      who_sees_whom += t.region.panoramas[p].record.id + ":";
      for (const std::uint32_t other : neighbourhoods[p]) {
        needed.insert(other);
        who_sees_whom += " " + t.region.panoramas[other].record.id;
      }
      who_sees_whom += "\n";
    }
    KeyParts key;
    key.Add("program", Format("similarity %d", kSimilarityVersion));
    key.Add("options", Format("%d %d", options.num_similar, context.plan.options.max_words));
    key.Add("vocabulary", weighed.parts.at("file"));
    key.Add("neighbours", who_sees_whom);
    for (const std::uint32_t p : needed)
      key.AddPanorama(t.region.panoramas[p].record.id, t.words_keys[p]);
    receipt.key = key.Hex(), receipt.parts = key.digests();
    const fs::path file = context.work.Content("similarity", receipt.key);
    if (!ReadSimilarityRows(file).ok()) {
      const std::size_t per_panorama = t.content.directions.size();
      std::vector<BagOfWords> bags(t.region.panoramas.size() * per_panorama);
      std::vector<std::uint32_t> panorama_of_view;
      for (std::uint32_t p = 0; p < t.region.panoramas.size(); ++p)
        panorama_of_view.insert(panorama_of_view.end(), per_panorama, p);
      const std::vector<std::uint32_t> wanted(needed.begin(), needed.end());
      tbb::parallel_for(std::size_t{0}, wanted.size(), [&](std::size_t i) {
        const std::vector<ViewWords> words = ReadWordsOf(context, t.words_keys[wanted[i]]);
        for (std::size_t v = 0; v < std::min(per_panorama, words.size()); ++v) {
          bags[wanted[i] * per_panorama + v] =
              MakeBag(words[v], vocabulary, context.plan.options.max_words);
        }
      });
      const SimilarityIndex index = SimilarityRows(bags, panorama_of_view, neighbourhoods, options,
                                                   t.begin * per_panorama, t.end * per_panorama);
      std::vector<std::string> ids;
      for (const ExtractedPanorama& p : t.region.panoramas) ids.push_back(p.record.id);
      WriteSimilarityRows(file, index, ids, per_panorama);
      const auto before = FindReceipt<FileReceipt>(context.work, Stage::kSimilarity, tile);
      report.AddRedone(tile, before ? &before->parts : nullptr, key.digests());
      report.num_bytes_written = fs::file_size(file);
    }
  }
  receipt.made_from = t.region.made_from;
  WriteReceipt(context.work, Stage::kSimilarity, tile, receipt);
  return report;
}

}  // namespace panofix::stages
