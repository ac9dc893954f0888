#include "common/estimate/bundle_residual.h"

#include <cmath>

namespace panofix {

Eigen::Matrix3d LeftJacobianSo3(const Eigen::Vector3d& phi) {
  const double angle2 = phi.squaredNorm(), angle = std::sqrt(angle2);
  const Eigen::Matrix3d skew = Skew(phi);
  // Below this angle the series is exact to rounding and the closed form is not.
  const bool tiny = angle < 1e-4;
  const double a = tiny ? 0.5 - angle2 / 24 : (1 - std::cos(angle)) / angle2;
  const double b = tiny ? 1.0 / 6 - angle2 / 120 : (angle - std::sin(angle)) / (angle2 * angle);
  return Eigen::Matrix3d::Identity() + a * skew + b * skew * skew;
}

Eigen::Vector3d MovedPoint(const Correspondence& match, const Vector6d& panorama_delta) {
  return match.point_in_map - match.lever_in_map + panorama_delta.head<3>() +
         ExpSo3(panorama_delta.tail<3>()) * match.lever_in_map;
}

bool BundleResidual(const Correspondence& match, const Eigen::Matrix2d& whitener,
                    const Rigid3& start, const Vector6d& frame_delta,
                    const Vector6d& panorama_delta, Eigen::Vector2d* residual,
                    Matrix26d* frame_jacobian, Matrix26d* panorama_jacobian) {
  const CameraFrame frame(PerturbPose(start, frame_delta));
  const Eigen::Vector3d point_in_map = MovedPoint(match, panorama_delta);
  const Eigen::Vector3d point = frame.ToCam(point_in_map);
  if (!(point.z() >= kMinDepth_m)) return false;
  *residual = whitener * (point.head<2>() / point.z() - match.bearing_in_cam);
  const Matrix23d point_jacobian = whitener * PointJacobian(frame, point);
  if (frame_jacobian != nullptr) {
    *frame_jacobian = PoseJacobian(point_jacobian, point_in_map - frame.position_in_map);
    frame_jacobian->rightCols<3>() *= LeftJacobianSo3(frame_delta.tail<3>());
  }
  if (panorama_jacobian != nullptr) {
    const Eigen::Vector3d lever = ExpSo3(panorama_delta.tail<3>()) * match.lever_in_map;
    panorama_jacobian->leftCols<3>() = point_jacobian;
    panorama_jacobian->rightCols<3>() =
        -point_jacobian * Skew(lever) * LeftJacobianSo3(panorama_delta.tail<3>());
  }
  return true;
}

}  // namespace panofix
