#include "common/geometry/attitude.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace panofix {

Eigen::Matrix3d EnuFromBody(const Attitude& attitude) {
  using Eigen::AngleAxisd;
  using Eigen::Vector3d;
  return (AngleAxisd(-attitude.heading_deg * kRadPerDeg, Vector3d::UnitZ()) *
          AngleAxisd(attitude.pitch_deg * kRadPerDeg, Vector3d::UnitX()) *
          AngleAxisd(attitude.roll_deg * kRadPerDeg, Vector3d::UnitY()))
      .toRotationMatrix();
}

Attitude AttitudeFromEnu(const Eigen::Matrix3d& enu_from_body) {
  const Eigen::Vector3d right = enu_from_body.col(0), forward = enu_from_body.col(1),
                        up = enu_from_body.col(2);
  Attitude attitude;
  const double horizontal = std::hypot(forward.x(), forward.y());
  attitude.pitch_deg = std::atan2(forward.z(), horizontal) / kRadPerDeg;
  double heading_rad;
  if (horizontal > 1e-12) {
    heading_rad = std::atan2(forward.x(), forward.y());
    // The third row of Rz Rx Ry is (-cos(pitch) sin(roll), sin(pitch), cos(pitch) cos(roll)).
    attitude.roll_deg = std::atan2(-right.z(), up.z()) / kRadPerDeg;
    if (attitude.roll_deg <= -180.0) attitude.roll_deg = 180.0;
  } else {
    heading_rad = std::atan2(-right.y(), right.x());
  }
  attitude.heading_deg = std::fmod(heading_rad / kRadPerDeg + 360.0, 360.0);
  return attitude;
}

Eigen::Matrix3d BodyFromCam() {
  Eigen::Matrix3d m;
  m << 1, 0, 0,  //
      0, 0, 1,   //
      0, -1, 0;
  return m;
}

double AngleDifferenceDeg(double a_deg, double b_deg) {
  double d = std::fmod(a_deg - b_deg + 180.0, 360.0);
  if (d < 0) d += 360.0;
  return d < 360.0 ? d - 180.0 : -180.0;  // the sum may round up to 360
}

}  // namespace panofix
