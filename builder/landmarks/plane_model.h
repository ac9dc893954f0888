#pragma once
// A depth plane with its three errors (relative distance, two tilts), as the refinement moves it.
// Its rows agree with SurfaceRow of common/estimate. Private to the module.

#include <Eigen/Core>
#include <optional>

#include "builder/landmarks/layer_types.h"

namespace panofix {

// n . X = d with n of unit length, in the pano frame. A delta (s, t1, t2) makes it
// (n + t1 e1 + t2 e2) . X = d (1 + s), e1 and e2 spanning the plane.
struct PlaneModel {
  Eigen::Vector3d normal, e1, e2;
  double d_m = 0;

  // nullopt for a raster's surface, or a plane that is none (zero or not finite).
  [[nodiscard]] static std::optional<PlaneModel> Of(const LandmarkPanorama& panorama,
                                                    std::uint8_t surface_idx);
  [[nodiscard]] Eigen::Vector3d Normal(const Eigen::Vector3d& delta) const {
    return normal + delta(1) * e1 + delta(2) * e2;
  }
  [[nodiscard]] double Distance(const Eigen::Vector3d& delta) const { return d_m * (1 + delta(0)); }
  // d (Normal . x - Distance) / d delta.
  [[nodiscard]] Eigen::RowVector3d Row(const Eigen::Vector3d& x) const {
    return {-d_m, e1.dot(x), e2.dot(x)};
  }
  [[nodiscard]] DepthPlane Refined(const Eigen::Vector3d& delta) const;
  // Where the point's ray meets the moved plane; the point itself where they hardly meet.
  [[nodiscard]] Eigen::Vector3d MovePoint(const Eigen::Vector3d& point,
                                          const Eigen::Vector3d& delta) const;
};

// 1-sigma errors of a plane: share of its distance, and its direction.
struct PlaneSigmas {
  double distance_share = 0, normal_rad = 0;
};
[[nodiscard]] PlaneSigmas PriorSigmas(const MapErrors& errors);

// Part of a landmark's range error that its plane does not share with its other points (metres).
[[nodiscard]] double OwnRangeSigma_m(const Landmark& landmark,
                                     const std::optional<PlaneModel>& plane,
                                     const MapErrors& errors);
// Part that the plane's points share, along the ray to the landmark (metres).
[[nodiscard]] double SharedRangeSigma_m(const Eigen::Vector3d& point, const PlaneModel& plane,
                                        const PlaneSigmas& sigmas);

// What is known of a landmark's distance before any other panorama: normal . X = d up to sigma, in
// its panorama's frame. The plane's own error is not in it. A raster's point has the plane across
// its ray.
struct DepthPrior {
  Eigen::Vector3d normal;
  double d_m = 0;
  double sigma_m = 0;
};
[[nodiscard]] DepthPrior DepthPriorOf(const Landmark& landmark,
                                      const std::optional<PlaneModel>& plane,
                                      const Eigen::Vector3d& plane_delta, const MapErrors& errors);

}  // namespace panofix
