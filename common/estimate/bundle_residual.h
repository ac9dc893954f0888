#pragma once
// The residual that the local bundle adjustment minimises, apart from Ceres so that its derivatives
// can be tested.

#include <Eigen/Core>

#include "common/estimate/projection.h"

namespace panofix {

// Jl with Exp(phi + d) = Exp(Jl(phi) d) Exp(phi) to first order.
[[nodiscard]] Eigen::Matrix3d LeftJacobianSo3(const Eigen::Vector3d& phi);

// How a depth plane's error (relative distance, two tilts of its normal, radians) stretches the ray to
// a point on it: relative range change = row * delta. From n . X = d, the tilts acting as
// -(e . v) / (n . v) along the ray v; zero tilts where the normal is not known.
[[nodiscard]] Eigen::RowVector3d SurfaceRow(const Correspondence& match);

// Part of the point's range error that is its own, once its plane's shared error is a variable.
[[nodiscard]] Correspondence WithoutSharedError(const Correspondence& match);

// Where the corrections put the point: centre + delta_t + Exp(delta_r) * lever * (1 + row * surface).
[[nodiscard]] Eigen::Vector3d MovedPoint(const Correspondence& match, const Vector6d& panorama_delta,
                                         const Eigen::Vector3d& surface_delta);

// Whitened residual of `match` seen from `start` perturbed by `frame_delta`, its point moved with
// its panorama and its surface. Jacobians (2x6, 2x6, 2x3, with respect to the deltas at their values)
// may be null. False, with nothing written, where the point is behind the camera.
[[nodiscard]] bool BundleResidual(const Correspondence& match, const Eigen::Matrix2d& whitener,
                                  const Rigid3& start, const Vector6d& frame_delta,
                                  const Vector6d& panorama_delta,
                                  const Eigen::Vector3d& surface_delta, Eigen::Vector2d* residual,
                                  Matrix26d* frame_jacobian, Matrix26d* panorama_jacobian,
                                  Matrix23d* surface_jacobian);

}  // namespace panofix
