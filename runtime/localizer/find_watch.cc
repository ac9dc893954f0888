#include "runtime/localizer/find_watch.h"

#include <algorithm>

#include "common/base/time_window.h"

namespace panofix {

void FindWatch::Advance(std::int64_t now_ns) { ForgetOld(now_ns, options_.max_age_s, &finds_); }

int FindWatch::CountAlong(const Find& first) const {
  const Find& last = finds_.back();
  const double duration_s = SecondsBetween(first.timestamp_ns, last.timestamp_ns);
  const Eigen::Vector3d way = last.map_from_cam.translation - first.map_from_cam.translation;
  const Eigen::Quaterniond& from = first.map_from_cam.rotation;
  if (!(duration_s > 0) || way.norm() < options_.min_way_m ||
      way.norm() > options_.max_speed_m_per_s * duration_s ||
      AngleBetween(from, last.map_from_cam.rotation) >
          options_.max_turn_rad + options_.max_turn_rate_rad_per_s * duration_s) {
    return 0;
  }
  return static_cast<int>(std::count_if(finds_.begin(), finds_.end(), [&](const Find& find) {
    const double share = SecondsBetween(first.timestamp_ns, find.timestamp_ns) / duration_s;
    const Eigen::Vector3d expected = first.map_from_cam.translation + share * way;
    return find.is_firm && share >= 0 &&
           (find.map_from_cam.translation - expected).norm() <= options_.max_off_m &&
           AngleBetween(find.map_from_cam.rotation,
                        from.slerp(share, last.map_from_cam.rotation)) <= options_.max_turn_rad;
  }));
}

std::vector<Rigid3> FindWatch::Before(std::int64_t now_ns, std::size_t most) const {
  std::vector<Rigid3> before;
  for (auto find = finds_.rbegin(); find != finds_.rend() && before.size() < most; ++find) {
    if (find->timestamp_ns < now_ns) before.push_back(find->map_from_cam);
  }
  return before;
}

void FindWatch::Add(std::int64_t now_ns, const Rigid3& map_from_cam, bool is_firm) {
  // A frame does not confirm itself.
  if (!finds_.empty() && finds_.back().timestamp_ns == now_ns) finds_.pop_back();
  finds_.push_back({now_ns, map_from_cam, is_firm});
}

bool FindWatch::IsConfirmed() const {
  if (finds_.empty() || !finds_.back().is_firm) return false;
  const auto num_firm =
      std::count_if(finds_.begin(), finds_.end(), [](const Find& find) { return find.is_firm; });
  return std::any_of(finds_.begin(), finds_.end(), [&](const Find& first) {
    const int num_along = first.is_firm ? CountAlong(first) : 0;
    return num_along >= options_.min_finds && 2 * num_along >= num_firm;
  });
}

}  // namespace panofix
