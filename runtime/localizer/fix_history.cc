#include "runtime/localizer/fix_history.h"

#include <algorithm>

namespace panofix {
namespace {

double Seconds(std::int64_t duration_ns) { return 1e-9 * static_cast<double>(duration_ns); }

}  // namespace

void FixHistory::Advance(std::int64_t now_ns) {
  if (seeds_.empty() && poses_.empty()) return;
  // Compared before they are subtracted: times from outside may be anything.
  const bool forward = now_ns > last_fix_ns_;
  const double age_s =
      static_cast<double>(now_ns) * 1e-9 - static_cast<double>(last_fix_ns_) * 1e-9;
  if (!forward || age_s > options_.prediction_age_s) poses_.clear();
  if (!forward || age_s > options_.window_age_s) seeds_.clear();
}

void FixHistory::Add(std::int64_t now_ns, const Rigid3& map_from_cam,
                     const std::vector<std::uint32_t>& views, bool degraded) {
  seeds_.assign(views.begin(), views.begin() + static_cast<std::ptrdiff_t>(
                                                   std::min(views.size(), options_.max_seeds)));
  last_fix_ns_ = now_ns;
  if (degraded) {
    poses_.clear();
    return;
  }
  poses_.push_back({now_ns, map_from_cam});
  if (poses_.size() > 2) poses_.erase(poses_.begin());
}

void FixHistory::Lose() {
  seeds_.clear();
  poses_.clear();
}

std::vector<Rigid3> FixHistory::Predictions(std::int64_t now_ns) const {
  std::vector<Rigid3> predictions;
  if (poses_.size() == 2) {
    const double step_s = Seconds(poses_[1].timestamp_ns - poses_[0].timestamp_ns);
    Rigid3 moved = poses_[1].map_from_cam;
    moved.translation += (moved.translation - poses_[0].map_from_cam.translation) *
                         (Seconds(now_ns - poses_[1].timestamp_ns) / step_s);
    predictions.push_back(moved);
  }
  if (!poses_.empty()) predictions.push_back(poses_.back().map_from_cam);
  return predictions;
}

}  // namespace panofix
