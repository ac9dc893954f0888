#pragma once
// Whether matches that agree with a pose agree with the camera's focal length too.

#include <span>

#include "common/estimate/correspondence.h"

namespace panofix {

struct FocalCheck {
  double error = 0;    // relative: the true focal length is the stated one times (1 + error)
  double sigma = 1e9;  // 1-sigma of it; large where the matches say nothing
};

// Frees the focal length beside a pose that was refined without it: one Gauss-Newton step of both,
// Tukey weights at the pose. A wrong calibration moves the pose along its line of sight with small
// residuals, which no chi-square shows; points at several depths do. Never throws on data.
[[nodiscard]] FocalCheck CheckFocal(std::span<const Correspondence> matches,
                                    const Rigid3& cam_from_map, double tukey_t);

}  // namespace panofix
