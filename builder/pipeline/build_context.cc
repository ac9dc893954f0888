#include "builder/pipeline/build_context.h"

#include <algorithm>
#include <numeric>

#include "builder/tiling/quadkey.h"
#include "common/io/sha256.h"

namespace panofix {
namespace {

std::vector<std::uint32_t> Matching(const std::vector<std::string>& names,
                                    const std::string& name) {
  std::vector<std::uint32_t> indices;
  for (std::uint32_t i = 0; i < names.size(); ++i) {
    if (names[i] == name) indices.push_back(i);
  }
  return indices;
}

}  // namespace

BuildContext::BuildContext(const std::filesystem::path& work_folder)
    : work(work_folder),
      plan(ReadPlan(work)),
      camera(ValueOrThrow(ReadCameraYaml(work.camera()))),
      rectifier(camera.WithoutDistortion(),
                RingOfViews(plan.options.num_views, plan.options.view_pitch_deg)) {}

MadeFrom BuildContext::MadeFromPlan(const std::vector<std::string>& shards) const {
  // Name and number of the bundle change every night, and nothing with them.
  BuildOptions options = plan.options;
  options.name.clear(), options.build = 0;
  MadeFrom made_from{{"options", Sha256Hex(FormatOptions(options) + ToCameraYaml(camera, "camera") +
                                           plan.vocabulary_sha256)}};
  for (const std::string& shard : shards) {
    const auto found = plan.shards.find(shard);
    if (found != plan.shards.end()) made_from["records/" + shard] = found->second.records_sha256;
  }
  return made_from;
}

std::vector<std::uint32_t> Region::OfShard(const std::string& name) const {
  return Matching(shard, name);
}

std::vector<std::uint32_t> Region::OfTile(const std::string& name) const {
  return Matching(tile, name);
}

Region ReadRegion(const BuildContext& context, const std::vector<std::string>& shards) {
  struct Entry {
    std::string tile, shard;
    ExtractedPanorama panorama;
  };
  std::vector<Entry> entries;
  Region region;
  region.made_from = context.MadeFromPlan(shards);
  for (const std::string& shard : shards) {
    const auto receipt =
        ReadReceipt<ExtractReceipt>(context.work, Stage::kExtract, shard, &region.made_from);
    std::vector<PanoramaRecord> records = ReadRecords(context.work, context.plan, shard);
    auto record = records.begin();  // both ascend by id
    for (const ExtractReceipt::Panorama& p : receipt.panoramas) {
      while (record != records.end() && record->id < p.made.id) ++record;
      if (record == records.end() || record->id != p.made.id) {
        throw Error(ErrorCode::kTryAgain, "panorama " + p.made.id +
                                              " is no longer in the plan; run: panofix-builder " +
                                              StageCommand(Stage::kExtract, shard));
      }
      const std::string tile = Quadkey(record->position);
      entries.push_back({tile,
                         shard,
                         {std::move(*record), p.made.key, p.made.parts,
                          context.work.Content("features", p.made.key), p.has_depth}});
      ++record;
    }
  }
  std::sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
    return std::tie(a.tile, a.panorama.record.id) < std::tie(b.tile, b.panorama.record.id);
  });
  for (Entry& entry : entries) {
    region.panoramas.push_back(std::move(entry.panorama));
    region.shard.push_back(std::move(entry.shard));
    region.tile.push_back(std::move(entry.tile));
  }
  return region;
}

std::vector<std::string> WithHalo(const BuildPlan& plan, const std::string& shard) {
  const auto found = plan.shards.find(shard);
  if (found == plan.shards.end())
    throw Error(ErrorCode::kInvalidArgument, "--shard " + shard + ": not in the plan");
  std::vector<std::string> shards = found->second.halo;
  shards.push_back(shard);
  std::sort(shards.begin(), shards.end());
  return shards;
}

const std::vector<std::string>& ShardsOf(const BuildPlan& plan, const std::string& tile) {
  const auto found = plan.tiles.find(tile);
  if (found == plan.tiles.end())
    throw Error(ErrorCode::kInvalidArgument, "--tile " + tile + ": not in the plan");
  return found->second.shards;
}

}  // namespace panofix
