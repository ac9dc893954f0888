#include "runtime/localizer/past_frames.h"

#include <utility>

#include "common/base/time_window.h"

namespace panofix {

void PastFrames::Advance(std::int64_t now_ns, double max_age_s) {
  ForgetOld(now_ns, max_age_s, &fixes_);
}

void PastFrames::Add(std::int64_t now_ns, const Rigid3& map_from_cam,
                     std::vector<Correspondence> matches, std::size_t most) {
  if (most == 0) return;
  fixes_.push_back({now_ns, map_from_cam, std::move(matches)});
  if (fixes_.size() > most) fixes_.erase(fixes_.begin());
}

std::vector<PastFrame> PastFrames::InLocal(const MapBundle& bundle, const LocalFrame& local) const {
  std::vector<PastFrame> past;
  for (const Fix& fix : fixes_) {
    const Rigid3 local_from_cam(fix.map_from_cam.rotation,
                                local.FromMap(fix.map_from_cam.translation));
    past.push_back({local_from_cam.Inverse(), fix.matches});
    for (Correspondence& match : past.back().matches) {
      const MapPanorama& panorama =
          bundle.panoramas()[static_cast<std::size_t>(match.panorama_idx)];
      match.point_in_map = local.LocalFromPano(panorama).translation + match.lever_in_map;
    }
  }
  return past;
}

}  // namespace panofix
