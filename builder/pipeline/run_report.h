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

// What the joint refinement did to a panorama.
struct RefinementReport {
  std::string id;
  double shift_m = 0, turn_deg = 0;                      // from its geotag
  double residual_before_px = 0, residual_after_px = 0;  // median over its tracks
  int num_tracks = 0;
  bool is_flagged = false;  // its geotag cannot be reconciled; it keeps it and is weighed down
};

struct RunReport {
  std::vector<StageReport> stages;
  std::vector<SetAside> set_aside;        // panoramas left out, with their reasons
  std::vector<SetAside> without_depth;    // panoramas in the map whose depth is missing or unusable
  std::vector<RefinementReport> refined;  // in bundle order
  std::int64_t num_panoramas = 0, num_stations = 0, num_views = 0, num_landmarks = 0;
  std::uint64_t bundle_bytes = 0;
  std::uint64_t peak_memory_bytes = 0;
  std::string bundle_id;  // SHA-256 of the manifest

  [[nodiscard]] std::string ToJson() const;
  [[nodiscard]] std::string ToTable() const;
};

}  // namespace panofix
