#pragma once
// Which shards hold panoramas in reach of a group's: what it has to read beside its own.

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "builder/ingest/panorama_set.h"

namespace panofix {

struct Reach {
  int hops = 0;       // along the links, whichever end states them
  double metres = 0;  // and as the crow flies
};

// For every group (group_of[i] is the one of records[i]) the groups' values `shard_of` of all
// panoramas in reach of one of its own, its own included. May name a shard too many near the
// distance's limit, never one too few. Linear in the records at fixed density.
[[nodiscard]] std::map<std::string, std::set<std::string>> ShardsInReach(
    const std::vector<PanoramaRecord>& records, const std::vector<std::string>& group_of,
    const std::vector<std::string>& shard_of, const Reach& reach);

}  // namespace panofix
