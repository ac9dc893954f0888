#pragma once
// The residual that the local bundle adjustment minimises, apart from Ceres so that its derivatives
// can be tested.

#include <Eigen/Core>

#include "common/estimate/projection.h"

namespace panofix {

// Jl with Exp(phi + d) = Exp(Jl(phi) d) Exp(phi) to first order.
[[nodiscard]] Eigen::Matrix3d LeftJacobianSo3(const Eigen::Vector3d& phi);

// Where a panorama's correction puts the point: centre + delta_t + Exp(delta_r) * lever.
[[nodiscard]] Eigen::Vector3d MovedPoint(const Correspondence& match,
                                         const Vector6d& panorama_delta);

// Whitened residual of `match` seen from `start` perturbed by `frame_delta`, its point moved with
// its panorama. Jacobians (2x6, with respect to the deltas at their values) may be null. False,
// with nothing written, where the point is behind the camera.
[[nodiscard]] bool BundleResidual(const Correspondence& match, const Eigen::Matrix2d& whitener,
                                  const Rigid3& start, const Vector6d& frame_delta,
                                  const Vector6d& panorama_delta, Eigen::Vector2d* residual,
                                  Matrix26d* frame_jacobian, Matrix26d* panorama_jacobian);

}  // namespace panofix
