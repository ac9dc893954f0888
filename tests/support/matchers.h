#pragma once
// GoogleTest matchers for geometry. A NaN never matches.

#include <gmock/gmock.h>

#include "common/geometry/rigid3.h"

namespace panofix {

// Both transforms are the same within `tol_rad` of rotation and `tol_m` of translation. For a
// camera's position compare the map_from_cam poses.
MATCHER_P3(Rigid3Near, expected, tol_rad, tol_m, "") {
  const double angle_rad = AngleBetween(arg.rotation, expected.rotation);
  const double distance_m = (arg.translation - expected.translation).norm();
  *result_listener << "differs by " << angle_rad << " rad and " << distance_m << " m";
  return angle_rad <= tol_rad && distance_m <= tol_m;
}

}  // namespace panofix
