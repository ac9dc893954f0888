#pragma once
// What a build did, stage by stage: for people as a table, for machines as JSON.

#include <cstdint>
#include <string>
#include <vector>

#include "builder/ingest/panorama_set.h"

namespace panofix {

struct StageReport {
  std::string name;
  double duration_s = 0;
  std::int64_t num_items = 0, num_reused = 0;
  std::string unit;
};

struct RunReport {
  std::vector<StageReport> stages;
  std::vector<SetAside> set_aside;      // panoramas left out, with their reasons
  std::vector<SetAside> without_depth;  // panoramas in the map whose depth is missing or unusable
  std::int64_t num_panoramas = 0, num_views = 0, num_features = 0;
  std::uint64_t bundle_bytes = 0;
  std::uint64_t peak_memory_bytes = 0;
  std::string bundle_id;  // SHA-256 of the manifest

  [[nodiscard]] std::string ToJson() const;
  [[nodiscard]] std::string ToTable() const;
};

}  // namespace panofix
