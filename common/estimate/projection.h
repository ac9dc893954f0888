#pragma once
// The projection, its derivatives and the pose perturbation that every estimator here shares.

#include <Eigen/Core>
#include <cmath>

#include "common/estimate/correspondence.h"
#include "common/geometry/rigid3.h"

namespace panofix {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix26d = Eigen::Matrix<double, 2, 6>;
using Matrix23d = Eigen::Matrix<double, 2, 3>;

inline constexpr double kMinDepth_m = 0.1;  // nearer points count as behind the camera

// A camera pose as the inner loops want it: a matrix and the camera's position.
struct CameraFrame {
  Eigen::Matrix3d cam_from_map_rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d position_in_map = Eigen::Vector3d::Zero();
  CameraFrame() = default;
  explicit CameraFrame(const Rigid3& cam_from_map)
      : cam_from_map_rotation(cam_from_map.rotation.toRotationMatrix()),
        position_in_map(-(cam_from_map_rotation.transpose() * cam_from_map.translation)) {}
  [[nodiscard]] Eigen::Vector3d ToCam(const Eigen::Vector3d& point_in_map) const {
    return cam_from_map_rotation * (point_in_map - position_in_map);
  }
};

// d(x/z, y/z) / d(x, y, z).
[[nodiscard]] inline Matrix23d ProjectionJacobian(const Eigen::Vector3d& point_in_cam) {
  const double inverse_z = 1.0 / point_in_cam.z();
  Matrix23d jacobian;
  jacobian << inverse_z, 0, -point_in_cam.x() * inverse_z * inverse_z,  //
      0, inverse_z, -point_in_cam.y() * inverse_z * inverse_z;
  return jacobian;
}

// d(bearing) / d(point in map).
[[nodiscard]] inline Matrix23d PointJacobian(const CameraFrame& frame,
                                             const Eigen::Vector3d& point_in_cam) {
  return ProjectionJacobian(point_in_cam) * frame.cam_from_map_rotation;
}

// d(bearing) / d(delta_t, delta_r) from the point's Jacobian; order and meaning as in refine.h.
[[nodiscard]] inline Matrix26d PoseJacobian(const Matrix23d& point_jacobian,
                                            const Eigen::Vector3d& cam_to_point_in_map) {
  Matrix26d jacobian;
  jacobian.leftCols<3>() = -point_jacobian;
  jacobian.rightCols<3>().noalias() = point_jacobian * Skew(cam_to_point_in_map);
  return jacobian;
}

// Position + delta_t, map_from_cam = Exp(delta_r) * map_from_cam.
[[nodiscard]] inline Rigid3 PerturbPose(const Rigid3& cam_from_map, const Vector6d& delta) {
  const Rigid3 map_from_cam = cam_from_map.Inverse();
  return Rigid3((ExpSo3(delta.tail<3>()) * map_from_cam.rotation).normalized(),
                map_from_cam.translation + delta.head<3>())
      .Inverse();
}

// W with W^T W = inverse(covariance), lower triangular. Not finite where the covariance is not
// positive definite: callers drop such matches by the whitened residual's norm.
[[nodiscard]] inline Eigen::Matrix2d SqrtInformation(const Eigen::Matrix2d& covariance) {
  const double l00 = std::sqrt(covariance(0, 0));
  const double l10 = covariance(1, 0) / l00;
  const double l11 = std::sqrt(covariance(1, 1) - l10 * l10);
  Eigen::Matrix2d whitener;
  whitener << 1 / l00, 0, -l10 / (l00 * l11), 1 / l11;
  return whitener;
}

// ResidualCovariance from a point Jacobian at hand.
[[nodiscard]] Eigen::Matrix2d ResidualCovariance(const Correspondence& match,
                                                 const Matrix23d& point_jacobian);
// Every number in it is finite: others are never used.
[[nodiscard]] bool IsFinite(const Correspondence& match);

}  // namespace panofix
