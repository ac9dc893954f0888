#pragma once
// What every stage of a planned build starts from.

#include <set>
#include <string>
#include <vector>

#include "builder/pipeline/build_plan.h"
#include "builder/pipeline/extract_stage.h"
#include "builder/pipeline/receipts.h"

namespace panofix {

// Read once a process; immutable.
class BuildContext {
 public:
  // The plan in a work folder; throws Error.
  explicit BuildContext(const std::filesystem::path& work_folder);

  const WorkFolder work;
  const BuildPlan plan;
  const Camera camera;
  const Rectifier rectifier;

  // "options" (those that decide bytes) and the records of these shards.
  [[nodiscard]] MadeFrom MadeFromPlan(const std::vector<std::string>& shards) const;
};

// Panoramas of some shards as far as they were extracted, with what they were read from.
struct Region {
  std::vector<ExtractedPanorama> panoramas;  // usable ones, in bundle order: by tile, then id
  std::vector<std::string> shard, tile;      // of each
  MadeFrom made_from;

  // Indices of the panoramas of one shard or tile, ascending.
  [[nodiscard]] std::vector<std::uint32_t> OfShard(const std::string& name) const;
  [[nodiscard]] std::vector<std::uint32_t> OfTile(const std::string& name) const;
};

// Throws Error(kTryAgain) where a shard is not extracted yet.
[[nodiscard]] Region ReadRegion(const BuildContext& context,
                                const std::vector<std::string>& shards);

// A shard with its halo, as the plan has them.
[[nodiscard]] std::vector<std::string> WithHalo(const BuildPlan& plan, const std::string& shard);
// The tile's shards, those of the halo included. Throws Error(kInvalidArgument) where there is no
// such tile.
[[nodiscard]] const std::vector<std::string>& ShardsOf(const BuildPlan& plan,
                                                       const std::string& tile);

}  // namespace panofix
