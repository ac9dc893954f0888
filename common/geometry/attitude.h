#pragma once
// Heading, pitch and roll to rotation matrices and back (README, "Frames and angles").

#include <Eigen/Core>

namespace panofix {

// Degrees. heading: clockwise from true north; pitch: positive looks up; roll: positive drops the
// right side.
struct Attitude {
  double heading_deg = 0;
  double pitch_deg = 0;
  double roll_deg = 0;
};

inline constexpr double kRadPerDeg = 0.017453292519943295769;

// R_enu_from_body = Rz(-heading) Rx(pitch) Ry(roll): columns are the body's right, forward, up
// axes.
[[nodiscard]] Eigen::Matrix3d EnuFromBody(const Attitude& attitude);
// Inverse of EnuFromBody. heading in [0, 360), pitch in [-90, 90], roll in (-180, 180]; at
// pitch = +-90 the roll is set to 0.
[[nodiscard]] Attitude AttitudeFromEnu(const Eigen::Matrix3d& enu_from_body);
// Body (right, forward, up) from cam (right, down, forward): a constant rotation.
[[nodiscard]] Eigen::Matrix3d BodyFromCam();
// Smallest signed difference a - b of two angles in degrees, in [-180, 180).
[[nodiscard]] double AngleDifferenceDeg(double a_deg, double b_deg);

}  // namespace panofix
