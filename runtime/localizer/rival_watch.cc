#include "runtime/localizer/rival_watch.h"

namespace panofix {

void RivalWatch::Advance() {
  run_frames_ = has_pose_ ? run_frames_ + 1 : 0;
  ++frames_since_;
  has_pose_ = false;
}

bool RivalWatch::IsDue() const {
  return run_frames_ < options_.first_frames || frames_since_ >= options_.period_frames ||
         Share() > options_.wary_share;
}

void RivalWatch::Add(double support, double rival_support) {
  own_ = options_.kept * own_ + support;
  rival_ = options_.kept * rival_ + rival_support;
  frames_since_ = 0;
  has_pose_ = true;
}

}  // namespace panofix
