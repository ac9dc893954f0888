#include "common/estimate/bundle_residual.h"

#include <algorithm>
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

Eigen::RowVector3d SurfaceRow(const Correspondence& match) {
  Eigen::RowVector3d row(1, 0, 0);
  const Eigen::Vector3d& n = match.surface_normal_in_map;
  const double range_m = match.lever_in_map.norm();
  if (!(n.squaredNorm() > 0.5) || !(range_m > 0)) return row;
  const Eigen::Vector3d v = match.lever_in_map / range_m;
  // Beyond this obliquity the plane says nothing of the range any more.
  constexpr double kMinCosine = 0.05;
  const double cosine = n.dot(v);
  if (std::abs(cosine) < kMinCosine) return row;
  const Eigen::Vector3d e1 = n.unitOrthogonal(), e2 = n.cross(e1);
  row(1) = -e1.dot(v) / cosine;
  row(2) = -e2.dot(v) / cosine;
  return row;
}

Correspondence WithoutSharedError(const Correspondence& match) {
  Correspondence own = match;
  const Eigen::RowVector3d row = SurfaceRow(match);
  const double shared_m = match.lever_in_map.norm() *
                          std::hypot(match.surface_distance_sigma,
                                     match.surface_normal_sigma_rad * row.tail<2>().norm());
  const double total_m = match.range_sigma_in_map.norm();
  if (total_m <= 0) return own;
  // A point always keeps some error of its own: the plane is not the wall.
  constexpr double kLeastOwnShare = 0.1;
  const double own_sq = std::max(total_m * total_m - shared_m * shared_m,
                                 kLeastOwnShare * kLeastOwnShare * total_m * total_m);
  own.range_sigma_in_map *= std::sqrt(own_sq) / total_m;
  return own;
}

Eigen::Vector3d MovedPoint(const Correspondence& match, const Vector6d& panorama_delta,
                           const Eigen::Vector3d& surface_delta) {
  return match.point_in_map - match.lever_in_map + panorama_delta.head<3>() +
         ExpSo3(panorama_delta.tail<3>()) * match.lever_in_map * (1 + SurfaceRow(match).dot(surface_delta));
}

bool BundleResidual(const Correspondence& match, const Eigen::Matrix2d& whitener,
                    const Rigid3& start, const Vector6d& frame_delta,
                    const Vector6d& panorama_delta, const Eigen::Vector3d& surface_delta,
                    Eigen::Vector2d* residual, Matrix26d* frame_jacobian,
                    Matrix26d* panorama_jacobian, Matrix23d* surface_jacobian) {
  const CameraFrame frame(PerturbPose(start, frame_delta));
  const Eigen::Vector3d point_in_map = MovedPoint(match, panorama_delta, surface_delta);
  const Eigen::Vector3d point = frame.ToCam(point_in_map);
  if (!(point.z() >= kMinDepth_m)) return false;
  *residual = whitener * (point.head<2>() / point.z() - match.bearing_in_cam);
  const Matrix23d point_jacobian = whitener * PointJacobian(frame, point);
  if (frame_jacobian != nullptr) {
    *frame_jacobian = PoseJacobian(point_jacobian, point_in_map - frame.position_in_map);
    frame_jacobian->rightCols<3>() *= LeftJacobianSo3(frame_delta.tail<3>());
  }
  const Eigen::RowVector3d row = SurfaceRow(match);
  const Eigen::Vector3d turned = ExpSo3(panorama_delta.tail<3>()) * match.lever_in_map;
  if (panorama_jacobian != nullptr) {
    panorama_jacobian->leftCols<3>() = point_jacobian;
    panorama_jacobian->rightCols<3>() = -point_jacobian * Skew(turned * (1 + row.dot(surface_delta))) *
                                        LeftJacobianSo3(panorama_delta.tail<3>());
  }
  if (surface_jacobian != nullptr) *surface_jacobian = (point_jacobian * turned) * row;
  return true;
}

}  // namespace panofix
