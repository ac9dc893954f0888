#include "runtime/localizer/fix_history.h"

#include <algorithm>

#include "common/base/time_window.h"

namespace panofix {
namespace {

constexpr double kTurn_rad = 0.035;     // less is lost in a search's windows
constexpr double kMostTurnRatio = 1.5;  // nobody turns on and on

double Seconds(std::int64_t duration_ns) { return 1e-9 * static_cast<double>(duration_ns); }

}  // namespace

void FixHistory::Advance(std::int64_t now_ns) {
  if (seeds_.empty() && poses_.empty()) return;
  const bool forward = now_ns > last_fix_ns_;
  const double age_s = SecondsBetween(last_fix_ns_, now_ns);
  if (!forward || age_s > options_.prediction_age_s) poses_.clear();
  if (!forward || age_s > options_.window_age_s) seeds_.clear();
}

void FixHistory::Add(std::int64_t now_ns, const Rigid3& map_from_cam,
                     const std::vector<std::uint32_t>& views, bool degraded) {
  if (!views.empty())
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

std::vector<Rigid3> FixHistory::Predictions(std::int64_t now_ns) const {
  std::vector<Rigid3> predictions;
  if (poses_.empty()) return predictions;
  const Rigid3& last = poses_.back().map_from_cam;
  if (poses_.size() == 2) {
    const Rigid3& before = poses_[0].map_from_cam;
    const double ratio = Seconds(now_ns - poses_[1].timestamp_ns) /
                         Seconds(poses_[1].timestamp_ns - poses_[0].timestamp_ns);
    const Eigen::Vector3d step = (last.translation - before.translation) * ratio;
    Eigen::AngleAxisd turn(last.rotation * before.rotation.conjugate());
    turn.angle() *= std::min(ratio, kMostTurnRatio);
    if (turn.angle() > kTurn_rad) {
      predictions.emplace_back(turn * last.rotation, last.translation + turn * step);
    }
    predictions.emplace_back(last.rotation, last.translation + step);
  }
  predictions.push_back(last);
  return predictions;
}

}  // namespace panofix
