#pragma once
// What a runtime measured while it answered frames: the part of a score that poses.csv has no
// columns for.

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace panofix {

// Wall time of one frame by stage, milliseconds.
struct StageLatency {
  double preprocess_ms = 0, features_ms = 0, retrieval_ms = 0, matching_ms = 0, pose_ms = 0,
         total_ms = 0;
};

struct RunLogEntry {
  std::int64_t timestamp_ns = 0;
  StageLatency latency;
  std::int64_t num_compared = 0;  // database views that retrieval looked at
  std::int64_t num_database = 0;  // views in the map
};

struct RunLog {
  std::vector<RunLogEntry> frames;
  std::uint64_t resident_memory_bytes = 0;  // peak of the runtime; 0 = not known
};

[[nodiscard]] std::string ToJson(const RunLog& log);
// kNotFound or kBadData, naming the file.
[[nodiscard]] Result<RunLog> ReadRunLog(const std::filesystem::path& path);

}  // namespace panofix
