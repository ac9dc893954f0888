#include "builder/landmarks/plane_model.h"

#include <cmath>

#include "common/estimate/bundle_residual.h"

namespace panofix {
namespace {

// The plane's error as common/estimate knows it, in pano axes.
Correspondence AsCorrespondence(const Eigen::Vector3d& point, const PlaneModel& plane,
                                const PlaneSigmas& sigmas) {
  Correspondence match;
  match.point_in_map = match.lever_in_map = point;
  match.surface_normal_in_map = plane.normal;
  match.surface_distance_sigma = sigmas.distance_share;
  match.surface_normal_sigma_rad = sigmas.normal_rad;
  return match;
}

}  // namespace

std::optional<PlaneModel> PlaneModel::Of(const LandmarkPanorama& panorama,
                                         std::uint8_t surface_idx) {
  if (surface_idx == 0 || surface_idx >= panorama.planes.size()) return std::nullopt;
  const DepthPlane& plane = panorama.planes[surface_idx];
  const Eigen::Vector3d n = plane.normal_in_pano.cast<double>();
  const double length = n.norm();
  if (!std::isfinite(length) || length < 1e-6 || !std::isfinite(plane.d_m)) return std::nullopt;
  PlaneModel model;
  model.normal = n / length;
  model.d_m = double{plane.d_m} / length;
  model.e1 = model.normal.unitOrthogonal();
  model.e2 = model.normal.cross(model.e1);
  return model;
}

DepthPlane PlaneModel::Refined(const Eigen::Vector3d& delta) const {
  const Eigen::Vector3d n = Normal(delta);
  const double length = n.norm();
  return {(n / length).cast<float>(), static_cast<float>(Distance(delta) / length)};
}

Eigen::Vector3d PlaneModel::MovePoint(const Eigen::Vector3d& point,
                                      const Eigen::Vector3d& delta) const {
  constexpr double kMostStretch = 1.5;  // a plane hardly met says nothing of the range
  const Eigen::RowVector3d row = SurfaceRow(AsCorrespondence(point, *this, {}));
  const double scale = (1 + delta(0)) / (1 - row(1) * delta(1) - row(2) * delta(2));
  return scale > 1 / kMostStretch && scale < kMostStretch ? Eigen::Vector3d(scale * point) : point;
}

PlaneSigmas PriorSigmas(const MapErrors& errors) {
  return {errors.range_sigma_share, errors.normal_sigma_deg * kRadPerDeg};
}

double OwnRangeSigma_m(const Landmark& landmark, const std::optional<PlaneModel>& plane,
                       const MapErrors& errors) {
  if (!plane) return double{landmark.range_sigma_m};
  const Eigen::Vector3d point = landmark.point_in_pano.cast<double>();
  Correspondence match = AsCorrespondence(point, *plane, PriorSigmas(errors));
  match.range_sigma_in_map = double{landmark.range_sigma_m} * point.normalized();
  return WithoutSharedError(match).range_sigma_in_map.norm();
}

double SharedRangeSigma_m(const Eigen::Vector3d& point, const PlaneModel& plane,
                          const PlaneSigmas& sigmas) {
  const Eigen::RowVector3d row = SurfaceRow(AsCorrespondence(point, plane, sigmas));
  return point.norm() * std::hypot(sigmas.distance_share, sigmas.normal_rad * row.tail<2>().norm());
}

DepthPrior DepthPriorOf(const Landmark& landmark, const std::optional<PlaneModel>& plane,
                        const Eigen::Vector3d& plane_delta, const MapErrors& errors) {
  constexpr double kLeastSigma_m = 0.01;  // no wall is that flat
  const Eigen::Vector3d point = landmark.point_in_pano.cast<double>();
  const Eigen::Vector3d ray = point.normalized();
  DepthPrior prior;
  prior.normal = plane ? plane->Normal(plane_delta) : ray;
  prior.d_m = plane ? plane->Distance(plane_delta) : point.norm();
  const double cosine = plane ? std::abs(plane->normal.dot(ray)) : 1.0;
  prior.sigma_m = std::max(kLeastSigma_m, OwnRangeSigma_m(landmark, plane, errors) * cosine);
  return prior;
}

}  // namespace panofix
