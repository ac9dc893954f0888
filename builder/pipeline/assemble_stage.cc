// The last stage before publishing: graph and manifest of what the others made.
#include <unordered_map>

#include "builder/pipeline/placement.h"
#include "builder/pipeline/similarity_file.h"
#include "builder/pipeline/stages.h"
#include "builder/publish/bundle_parts.h"
#include "common/base/log.h"
#include "common/io/sha256.h"

namespace panofix::stages {
namespace {

namespace fs = std::filesystem;

constexpr char kGenerator[] = "panofix-builder " PANOFIX_VERSION;

// All receipts of the build, each looked at once; and whether they are of one build.
class Receipts {
 public:
  explicit Receipts(const BuildContext& context) : context_(context) {
    std::vector<std::string> shards;
    for (const auto& [shard, unused] : context.plan.shards) shards.push_back(shard);
    region = ReadRegion(context, shards);
    current_ = region.made_from;
    for (const std::string& shard : shards) {
      extracted.push_back(Read<ExtractReceipt>(Stage::kExtract, shard));
      augmented.push_back(Read<AugmentReceipt>(Stage::kAugment, shard));
      if (context.plan.vocabulary_sha256.empty()) (void)Read<FileReceipt>(Stage::kSample, shard);
      (void)Read<WordsReceipt>(Stage::kWords, shard);
    }
    (void)Read<FileReceipt>(Stage::kTrain, kAllUnit);
    vocabulary = Read<FileReceipt>(Stage::kWeigh, kAllUnit);
    for (const auto& [tile, unused] : context.plan.tiles) {
      tiles[tile] = Read<TileReceipt>(Stage::kLandmarks, tile);
      similarity[tile] = Read<FileReceipt>(Stage::kSimilarity, tile);
    }
    for (const auto& [who, from] : sources_) CheckFresh(who, from);
  }
  [[nodiscard]] const MadeFrom& made_from() const { return current_; }

  Region region;
  std::vector<ExtractReceipt> extracted;
  std::vector<AugmentReceipt> augmented;
  FileReceipt vocabulary;
  std::map<std::string, TileReceipt> tiles;
  std::map<std::string, FileReceipt> similarity;

 private:
  template <typename Receipt>
  Receipt Read(Stage stage, const std::string& unit) {
    auto receipt = ReadReceipt<Receipt>(context_.work, stage, unit, &current_);
    sources_.emplace_back(StageCommand(stage, unit), receipt.made_from);
    return receipt;
  }
  void CheckFresh(const std::string& who, const MadeFrom& from) const {
    for (const auto& [name, sha256] : from) {
      const auto now = current_.find(name);
      if (now != current_.end() && now->second == sha256) continue;
      throw Error(ErrorCode::kTryAgain,
                  "out of date, its " + name + " has changed since; run: panofix-builder " + who);
    }
  }
  const BuildContext& context_;
  MadeFrom current_;
  std::vector<std::pair<std::string, MadeFrom>> sources_;
};

// All contents that a build's result depends on, as one hash: in bundle order, each panorama's
// extraction key, pose and links.
std::string DataSetHash(const std::vector<ExtractedPanorama>& panoramas) {
  Sha256 hash;
  for (const ExtractedPanorama& p : panoramas) {
    const PanoramaRecord& r = p.record;
    hash.Update(p.content_key + Format("\n%.17g %.17g %.17g %.17g %.17g %.17g\n",
                                       r.position.lat_deg, r.position.lon_deg, r.position.height_m,
                                       r.attitude.heading_deg, r.attitude.pitch_deg,
                                       r.attitude.roll_deg));
    for (const std::string& link : r.links) hash.Update(link + "\n");
  }
  return hash.FinishHex();
}

void Place(const BuildContext& context, const Receipts& receipts, BundleContent* content) {
  std::vector<PanoramaRecord> records;
  for (const ExtractedPanorama& p : receipts.region.panoramas) records.push_back(p.record);
  const MapFrame frame = ChooseFrame(context.plan.options.map_frame, records);
  content->manifest.map_frame = frame.parameters();
  content->panoramas = PlacePanoramas(records, frame);
  content->tile_of_panorama = receipts.region.tile;
  content->directions = context.rectifier.directions();
  std::unordered_map<std::string, std::uint32_t> index_of;
  for (std::uint32_t i = 0; i < records.size(); ++i) {
    content->panoramas[i].has_depth = receipts.region.panoramas[i].has_depth;
    index_of[records[i].id] = i;
  }
  for (const auto& [tile, receipt] : receipts.tiles) {
    for (const RefinedPose& refined : receipt.refined) {
      MapPanorama& panorama = content->panoramas[index_of.at(refined.report.id)];
      panorama.is_flagged = refined.report.is_flagged;
      if (!refined.is_moved) continue;
      const Geodetic at{refined.geodetic[0], refined.geodetic[1], refined.geodetic[2]};
      const auto& q = refined.enu_from_pano;
      const Eigen::Quaterniond enu_from_pano(q[3], q[0], q[1], q[2]);
      panorama.map_from_pano =
          Rigid3(frame.MapFromEnu(at) * enu_from_pano.toRotationMatrix(), frame.ToMap(at));
    }
  }
  std::vector<const AugmentReceipt::Panorama*> stations(records.size(), nullptr);
  for (const AugmentReceipt& shard : receipts.augmented) {
    for (const AugmentReceipt::Panorama& p : shard.panoramas) stations[index_of.at(p.made.id)] = &p;
  }
  for (std::uint32_t p = 0; p < stations.size(); ++p) {
    for (const auto& at : stations[p]->stations)
      content->stations.push_back({p, Eigen::Vector3d(at[0], at[1], at[2])});
  }
}

// D_DB x r of the tiles, in the bundle's numbers.
void JoinSimilarity(const BuildContext& context, const Receipts& receipts, BundleContent* content) {
  const auto per_station = static_cast<std::uint32_t>(content->directions.size());
  std::vector<std::uint32_t> first_view(content->panoramas.size());
  std::unordered_map<std::string, std::uint32_t> index_of;
  for (std::uint32_t s = 0; s < content->stations.size(); ++s) {
    const MapStation& station = content->stations[s];
    if (s == 0 || content->stations[s - 1].panorama_idx != station.panorama_idx)
      first_view[station.panorama_idx] = s * per_station;
  }
  for (std::uint32_t p = 0; p < content->panoramas.size(); ++p)
    index_of[content->panoramas[p].id] = p;
  SimilarityIndex& index = content->similarity;
  index.offsets = {0};
  for (const auto& [tile, receipt] : receipts.similarity) {
    if (receipt.key.empty()) continue;
    const fs::path file = context.work.Content("similarity", receipt.key);
    auto rows = ReadSimilarityRows(file);
    if (!rows.ok()) throw Error(ErrorCode::kTryAgain, rows.status().message());
    for (std::size_t i = 0; i < rows->views.size(); ++i) {
      index.views.push_back(first_view[index_of.at(rows->ids[rows->panoramas[i]])] +
                            rows->views[i]);
    }
    index.similarity.insert(index.similarity.end(), rows->similarity.begin(),
                            rows->similarity.end());
    const std::uint32_t before = index.offsets.back();
    for (std::size_t r = 1; r < rows->offsets.size(); ++r)
      index.offsets.push_back(before + rows->offsets[r]);
  }
}

void FillManifest(const BuildContext& context, const Receipts& receipts, Manifest* manifest) {
  const BuildPlan& plan = context.plan;
  manifest->name = plan.options.name;
  manifest->build = plan.options.build;
  manifest->generator = kGenerator;
  manifest->camera = context.camera;
  manifest->features = plan.options.extract.features;
  manifest->errors = plan.options.extract.errors;
  manifest->provenance = {plan.source, plan.licence, plan.height_datum,
                          DataSetHash(receipts.region.panoramas), OptionsJson(plan.options)};
  manifest->num_set_aside = static_cast<std::int64_t>(plan.set_aside.size());
  for (const ExtractReceipt& shard : receipts.extracted)
    manifest->num_set_aside += static_cast<std::int64_t>(shard.set_aside.size());
}

void AddPart(const BuildContext& context, const std::string& path, const fs::path& file,
             PartFile content, AssembleReceipt* receipt) {
  if (content.num_bytes == 0) {
    content = {static_cast<std::uint64_t>(fs::file_size(file)), ValueOrThrow(Sha256OfFile(file))};
  }
  receipt->parts.push_back({path, file.lexically_relative(context.work.root()).string(), content});
}

}  // namespace

UnitReport Assemble(const BuildContext& context) {
  const Receipts receipts(context);
  std::vector<SetAside> set_aside = context.plan.set_aside;
  for (const ExtractReceipt& shard : receipts.extracted)
    set_aside.insert(set_aside.end(), shard.set_aside.begin(), shard.set_aside.end());
  RefuseTooManySetAside(context.plan, set_aside);

  BundleContent content;
  Place(context, receipts, &content);
  JoinSimilarity(context, receipts, &content);
  Manifest& manifest = content.manifest;
  FillManifest(context, receipts, &manifest);
  AssembleReceipt receipt;
  receipt.made_from = receipts.made_from();
  KeyParts key;
  for (const auto& [name, sha256] : receipt.made_from) key.Add(name, sha256);
  const fs::path graph = context.work.Content("graphs", key.Hex());
  WriteGraph(graph, content);
  AddPart(context, "graph.h5", graph, {}, &receipt);
  AddPart(context, "vocabulary.h5", context.work.Content("vocabularies", receipts.vocabulary.key),
          {}, &receipt);
  for (const auto& [tile, made] : receipts.tiles) {
    if (made.tile.num_bytes == 0) continue;
    manifest.num_landmarks += made.num_landmarks;
    AddPart(context, "tiles/" + tile + ".h5", context.work.Content("tiles", made.key), made.tile,
            &receipt);
    if (made.images.num_bytes == 0) continue;
    AddPart(context, "images/" + tile + ".h5", context.work.Content("images", made.key),
            made.images, &receipt);
  }
  std::sort(receipt.parts.begin(), receipt.parts.end(),
            [](const auto& a, const auto& b) { return a.path < b.path; });
  for (const AssembleReceipt::Part& part : receipt.parts) {
    manifest.parts.push_back({part.path, part.content.num_bytes, part.content.sha256});
    // A vocabulary goes by its hash: a reused release keeps its own.
    if (part.path == "vocabulary.h5") manifest.vocabulary_release = "sha256:" + part.content.sha256;
  }
  manifest.num_panoramas = static_cast<std::int64_t>(content.panoramas.size());
  manifest.views_per_station = static_cast<int>(content.directions.size());
  manifest.num_stations = static_cast<std::int64_t>(content.stations.size());
  manifest.num_views = manifest.num_stations * manifest.views_per_station;
  receipt.manifest = ToJson(manifest);
  UnitReport report;
  report.num_items = report.num_new = 1;
  report.num_bytes_written = fs::file_size(graph);
  WriteReceipt(context.work, Stage::kAssemble, kAllUnit, receipt);
  return report;
}

}  // namespace panofix::stages
