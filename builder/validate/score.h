#pragma once
// The score table: what a drive's poses are worth against its truth.

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "common/drive/drive.h"
#include "common/drive/poses_csv.h"
#include "common/drive/run_log.h"

namespace panofix {

// A `fix` farther off than this is a false fix.
inline constexpr double kFalseFix_m = 5.0;

struct AccuracyBand {
  double position_m, attitude_deg;
};
inline constexpr std::array<AccuracyBand, 5> kAccuracyBands{
    {{0.25, 2}, {0.5, 5}, {1, 5}, {2, 10}, {5, 10}}};

// One frame against its truth.
struct FrameScore {
  std::int64_t timestamp_ns = 0;
  FixStatus status = FixStatus::kNoFix;
  bool has_truth = false, has_attitude_truth = false;
  double position_error_m = 0;    // 3-D; where there is a pose
  double attitude_error_deg = 0;  // angle of the relative rotation; 0 without attitude truth
  std::optional<double> nees;     // 4 degrees of freedom: east, north, up, heading
};

struct Percentiles {
  double p50 = 0, p95 = 0, p99 = 0;
};

struct ScoreTable {
  std::vector<FrameScore> frames;  // all of the drive, in order
  int num_frames = 0, num_with_truth = 0, num_fixes = 0, num_degraded = 0;
  std::array<int, kAccuracyBands.size()> num_within{};           // fixes within each band
  double median_position_error_m = 0, p95_position_error_m = 0;  // of fixes
  double median_attitude_error_deg = 0, p95_attitude_error_deg = 0;
  int num_scored = 0, num_attitude_scored = 0;  // fixes with truth; 0 leaves their errors unsaid
  int num_false_fixes = 0;
  int longest_gap_frames = 0;         // consecutive frames without a fix
  std::optional<double> nees_median;  // expectation 3.36: the median of chi-square with 4
  std::vector<std::pair<std::string, Percentiles>> latency_ms;  // by stage
  double resident_memory_mb = 0;
  double bundle_mb_per_km = 0;     // 0 = not known
  double comparisons_avoided = 0;  // share

  [[nodiscard]] double Share(int count) const;  // of all frames
  [[nodiscard]] std::string ToText() const;
  [[nodiscard]] std::string ToJson() const;
};

// Scores every frame of the drive; a frame without a row counts as no fix, one without truth counts
// in the shares of fixes only; without attitude truth the bands hold positions alone. Throws
// Error(kBadData) where no frame has truth or no pose belongs to a frame, or where times repeat.
// `log` may be empty; `bundle_mb_per_km` 0 where there is no bundle.
[[nodiscard]] ScoreTable Score(const Drive& drive, const std::vector<PoseRow>& poses,
                               const RunLog& log, double bundle_mb_per_km);

}  // namespace panofix
