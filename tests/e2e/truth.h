#pragma once
// Poses against the truth, by a way of its own: not the builder's score.

#include <cstdint>
#include <filesystem>
#include <map>
#include <vector>

#include "common/drive/drive.h"
#include "common/drive/poses_csv.h"

namespace panofix::e2e {

// Metres between two positions, heights included.
[[nodiscard]] inline double Distance_m(const Geodetic& a, const Geodetic& b) {
  const MapFrame frame = MapFrame::Tangent(a);
  return (frame.ToMap(b) - frame.ToMap(a)).norm();
}

// Position error of each row with a fix, metres by timestamp.
[[nodiscard]] inline std::map<std::int64_t, double> FixErrors_m(const std::vector<PoseRow>& poses,
                                                                const Drive& drive) {
  std::map<std::int64_t, Geodetic> truth;
  for (const TruthPose& pose : drive.truth) truth[pose.timestamp_ns] = pose.position;
  std::map<std::int64_t, double> errors_m;
  for (const PoseRow& row : poses) {
    if (row.status != FixStatus::kFix) continue;
    errors_m[row.timestamp_ns] = Distance_m(truth.at(row.timestamp_ns), row.pose->position);
  }
  return errors_m;
}

}  // namespace panofix::e2e
