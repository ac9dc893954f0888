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
  const double shared_m =
      match.lever_in_map.norm() * std::hypot(match.surface_distance_sigma,
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

PanoramaMotion::PanoramaMotion(const Vector6d& delta)
    : shift(delta.head<3>()),
      rotation(ExpSo3(delta.tail<3>()).toRotationMatrix()),
      left_jacobian(LeftJacobianSo3(delta.tail<3>())) {}

Eigen::Vector3d MovedPoint(const BundleMatch& match, const PanoramaMotion& panorama,
                           const Eigen::Vector3d& surface_delta) {
  const Correspondence& m = match.match;
  return m.point_in_map - m.lever_in_map + panorama.shift +
         panorama.rotation * m.lever_in_map * (1 + match.row.dot(surface_delta));
}

bool BundleResidual(const BundleMatch& match, const Eigen::Matrix2d& whitener,
                    const CameraFrame& frame, const PanoramaMotion& panorama,
                    const Eigen::Vector3d& surface_delta, Eigen::Vector2d* residual) {
  const Eigen::Vector3d point = frame.ToCam(MovedPoint(match, panorama, surface_delta));
  if (!(point.z() >= kMinDepth_m)) return false;
  *residual = whitener * (point.head<2>() / point.z() - match.match.bearing_in_cam);
  return true;
}

bool LinearizeBundle(const BundleMatch& match, const CameraFrame& frame,
                     const PanoramaMotion& panorama, const Eigen::Vector3d& surface_delta,
                     BundleLinear* linear) {
  const Correspondence& m = match.match;
  const Eigen::Vector3d turned = panorama.rotation * m.lever_in_map;
  const double stretch = 1 + match.row.dot(surface_delta);
  const Eigen::Vector3d point_in_map =
      m.point_in_map - m.lever_in_map + panorama.shift + turned * stretch;
  const Eigen::Vector3d point = frame.ToCam(point_in_map);
  if (!(point.z() >= kMinDepth_m)) return false;
  const Matrix23d point_jacobian = PointJacobian(frame, point);
  linear->whitener = SqrtInformation(ResidualCovariance(m, point_jacobian));
  linear->residual = linear->whitener * (point.head<2>() / point.z() - m.bearing_in_cam);
  const Matrix23d whitened = linear->whitener * point_jacobian;
  linear->by_frame = PoseJacobian(whitened, point_in_map - frame.position_in_map);
  linear->by_panorama.leftCols<3>() = whitened;
  linear->by_panorama.rightCols<3>() = -whitened * Skew(turned * stretch) * panorama.left_jacobian;
  linear->by_surface = (whitened * turned) * match.row;
  return true;
}

}  // namespace panofix
