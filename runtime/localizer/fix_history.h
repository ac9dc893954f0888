#pragma once
// What the last fixes say of the next frame, for as long as they say anything.

#include <cstdint>
#include <vector>

#include "common/geometry/rigid3.h"

namespace panofix {

struct FixHistoryOptions {
  double prediction_age_s = 3;  // an older fix predicts no pose
  double window_age_s = 20;   // nor opens a retrieval window beyond this: a vehicle may be anywhere
  std::size_t max_seeds = 4;  // views of the last fix that open the next window
};

// The last views and poses of the fixes so far. Times that run backwards make it forget.
class FixHistory {
 public:
  explicit FixHistory(const FixHistoryOptions& options = {}) : options_(options) {}

  // Drops what is too old for a frame at `now_ns`, or lies in its future. Call it first for each
  // frame.
  void Advance(std::int64_t now_ns);
  // A fix of the frame at `now_ns`; `views` best first, none = those of the fix before. A degraded
  // one opens the next window, but predicts nothing.
  void Add(std::int64_t now_ns, const Rigid3& map_from_cam, const std::vector<std::uint32_t>& views,
           bool degraded);
  // Whether a fix is young enough to predict from, degraded ones left out.
  [[nodiscard]] bool HasRecentFix() const { return !poses_.empty(); }
  // Views around which to search; empty = lost.
  [[nodiscard]] const std::vector<std::uint32_t>& seeds() const { return seeds_; }
  // map_from_cam where the camera may be at `now_ns`, likeliest first: moved and turned on as
  // between the last two fixes, moved on without the turn, standing still. At most three.
  [[nodiscard]] std::vector<Rigid3> Predictions(std::int64_t now_ns) const;

 private:
  struct PastPose {
    std::int64_t timestamp_ns;
    Rigid3 map_from_cam;
  };
  FixHistoryOptions options_;
  std::vector<std::uint32_t> seeds_;
  std::vector<PastPose> poses_;   // at most 2, older first
  std::int64_t last_fix_ns_ = 0;  // of seeds_
};

}  // namespace panofix
