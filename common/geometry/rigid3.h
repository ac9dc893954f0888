#pragma once
// Rigid transforms, named target_from_source: x_in_target = target_from_source * x_in_source.

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace panofix {

struct Rigid3 {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();  // metres

  Rigid3() = default;
  Rigid3(const Eigen::Quaterniond& r, const Eigen::Vector3d& t) : rotation(r), translation(t) {}
  Rigid3(const Eigen::Matrix3d& r, const Eigen::Vector3d& t)
      : rotation(Eigen::Quaterniond(r).normalized()), translation(t) {}

  [[nodiscard]] Rigid3 Inverse() const {
    const Eigen::Quaterniond inverse = rotation.conjugate();
    return {inverse, -(inverse * translation)};
  }
  [[nodiscard]] Eigen::Vector3d operator*(const Eigen::Vector3d& x) const {
    return rotation * x + translation;
  }
  [[nodiscard]] Rigid3 operator*(const Rigid3& b) const {
    return {(rotation * b.rotation).normalized(), rotation * b.translation + translation};
  }
};

// Angle of the rotation between two attitudes, radians in [0, pi].
[[nodiscard]] inline double AngleBetween(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) {
  return a.angularDistance(b);
}

// Skew-symmetric matrix: Skew(a) * b = a x b.
[[nodiscard]] inline Eigen::Matrix3d Skew(const Eigen::Vector3d& a) {
  Eigen::Matrix3d m;
  m << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
  return m;
}

// Exponential map of SO(3): rotation vector (radians) to quaternion.
[[nodiscard]] inline Eigen::Quaterniond ExpSo3(const Eigen::Vector3d& omega) {
  const double angle = omega.norm();
  if (angle < 1e-12) {
    return Eigen::Quaterniond(1, omega.x() / 2, omega.y() / 2, omega.z() / 2).normalized();
  }
  return Eigen::Quaterniond(Eigen::AngleAxisd(angle, omega / angle));
}

}  // namespace panofix
