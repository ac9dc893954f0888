#pragma once
// The residuals of the joint refinement, as Ceres wants them. Private to the module.
//
// Variables: a panorama's correction (6: shift, then rotation vector, both in local axes: centre +
// t, Exp(r) * local_from_pano), a plane's delta (3, as in PlaneModel), and a track's range as a
// multiple of its anchor's (1).

#include <ceres/ceres.h>

#include "builder/landmarks/plane_model.h"
#include "common/estimate/projection.h"

namespace panofix {

[[nodiscard]] Rigid3 Corrected(const Rigid3& local_from_pano, const Vector6d& correction);

// A track's point in an observing panorama's frame, and what moves it.
struct SightLine {
  Rigid3 local_from_anchor, local_from_observer;  // by the geotags
  Eigen::Vector3d point_in_anchor;                // at a range of 1

  struct Jacobians {
    Eigen::Matrix<double, 3, 6> anchor, observer;
    Eigen::Vector3d range;
  };
  // `jacobians` may be null.
  [[nodiscard]] Eigen::Vector3d PointInObserver(const Vector6d& anchor, const Vector6d& observer,
                                                double range, Jacobians* jacobians) const;
};

// Tangent coordinates (gnomonic, about the observed ray) of where the point is seen. False where it
// is behind. `jacobian` is by the point, and may be null.
[[nodiscard]] bool BearingOffset(const Eigen::Vector3d& observed_ray, const Eigen::Vector3d& point,
                                 Eigen::Vector2d* offset, Matrix23d* jacobian);

// Blocks: anchor's correction (6), observer's (6), range (1). Residual: bearing offset / sigma.
class BearingCost final : public ceres::SizedCostFunction<2, 6, 6, 1> {
 public:
  BearingCost(const SightLine& line, const Eigen::Vector3d& observed_ray, double sigma_rad)
      : line_(line), observed_ray_(observed_ray), sigma_rad_(sigma_rad) {}
  bool Evaluate(const double* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const SightLine line_;
  const Eigen::Vector3d observed_ray_;
  const double sigma_rad_;
};

// Distance of the point from an observer's depth plane / sigma. Blocks: anchor's correction,
// observer's, range, and the plane's delta where there is a plane.
class OffPlaneCost final : public ceres::CostFunction {
 public:
  OffPlaneCost(const SightLine& line, const DepthPrior& prior, const PlaneModel* plane);
  bool Evaluate(const double* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const SightLine line_;
  const DepthPrior prior_;
  const std::optional<PlaneModel> plane_;
};

// The same for the anchor's own plane. Blocks: range, and the plane's delta where there is a plane.
class AnchorPlaneCost final : public ceres::CostFunction {
 public:
  AnchorPlaneCost(const Eigen::Vector3d& point, const DepthPrior& prior, const PlaneModel* plane);
  bool Evaluate(const double* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const Eigen::Vector3d point_;
  const DepthPrior prior_;
  const std::optional<PlaneModel> plane_;
};

}  // namespace panofix
