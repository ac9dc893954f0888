#include "common/estimate/correspondence.h"

#include <algorithm>
#include <cmath>

#include "common/estimate/projection.h"

namespace panofix {
namespace {

// A keypoint better than this (0.0005 px at f = 500) is a caller's zero, not a measurement.
constexpr double kMinKeypointSigma = 1e-6;

}  // namespace

bool IsFinite(const Correspondence& match) {
  return match.bearing_in_cam.allFinite() && match.point_in_map.allFinite() &&
         match.range_sigma_in_map.allFinite() && match.lever_in_map.allFinite() &&
         std::isfinite(match.point_sigma_m) && std::isfinite(match.keypoint_sigma);
}

Eigen::Matrix2d ResidualCovariance(const Correspondence& match, const Matrix23d& point_jacobian) {
  const double keypoint_sigma = std::max(match.keypoint_sigma, kMinKeypointSigma);
  const Eigen::Vector2d range = point_jacobian * match.range_sigma_in_map;
  Eigen::Matrix2d covariance = range * range.transpose();
  covariance +=
      match.point_sigma_m * match.point_sigma_m * point_jacobian * point_jacobian.transpose();
  covariance.diagonal().array() += keypoint_sigma * keypoint_sigma;
  return covariance;
}

Eigen::Matrix2d ResidualCovariance(const Correspondence& match, const Rigid3& cam_from_map) {
  const CameraFrame frame(cam_from_map);
  Eigen::Vector3d point_in_cam = frame.ToCam(match.point_in_map);
  // Behind the camera there is no residual to speak of; the nearest depth keeps the answer finite.
  point_in_cam.z() = std::max(point_in_cam.z(), kMinDepth_m);
  return ResidualCovariance(match, PointJacobian(frame, point_in_cam));
}

bool BearingResidual(const Correspondence& match, const Rigid3& cam_from_map,
                     Eigen::Vector2d* residual) {
  const Eigen::Vector3d point_in_cam = cam_from_map * match.point_in_map;
  if (!(point_in_cam.z() >= kMinDepth_m)) return false;  // also a NaN
  *residual = point_in_cam.head<2>() / point_in_cam.z() - match.bearing_in_cam;
  return residual->allFinite();
}

}  // namespace panofix
