#pragma once
// The residual that the local bundle adjustment minimises, with its derivatives.

#include <Eigen/Core>

#include "common/estimate/projection.h"

namespace panofix {

// Jl with Exp(phi + d) = Exp(Jl(phi) d) Exp(phi) to first order.
[[nodiscard]] Eigen::Matrix3d LeftJacobianSo3(const Eigen::Vector3d& phi);

// A panorama's correction (shift, metres, then rotation vector, radians; map axes) as the inner
// loops want it.
struct PanoramaMotion {
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d left_jacobian = Eigen::Matrix3d::Identity();
  PanoramaMotion() = default;
  explicit PanoramaMotion(const Vector6d& delta);
};

// How a depth plane's error (relative distance, two tilts of its normal, radians) stretches the ray
// to a point on it: relative range change = row * delta. From n . X = d, the tilts acting as
// -(e . v) / (n . v) along the ray v; zero tilts where the normal is not known.
[[nodiscard]] Eigen::RowVector3d SurfaceRow(const Correspondence& match);

// Part of the point's range error that is its own, once its plane's shared error is a variable.
[[nodiscard]] Correspondence WithoutSharedError(const Correspondence& match);

// A match with what does not change while corrections are sought.
struct BundleMatch {
  Correspondence match;
  Eigen::RowVector3d row;  // SurfaceRow; of no meaning without a surface
  explicit BundleMatch(const Correspondence& m) : match(m), row(SurfaceRow(m)) {}
};

// Where the corrections put the point: centre + shift + rotation * lever * (1 + row * surface).
[[nodiscard]] Eigen::Vector3d MovedPoint(const BundleMatch& match, const PanoramaMotion& panorama,
                                         const Eigen::Vector3d& surface_delta);

// Whitened residual, its point moved with its panorama and its surface. False, with nothing
// written, where the point is behind the camera.
[[nodiscard]] bool BundleResidual(const BundleMatch& match, const Eigen::Matrix2d& whitener,
                                  const CameraFrame& frame, const PanoramaMotion& panorama,
                                  const Eigen::Vector3d& surface_delta, Eigen::Vector2d* residual);

// The residual, whitened by its covariance at these corrections, and its derivatives there, the
// whitener held fixed: by the frame's perturbation (order and meaning as in refine.h), by the
// panorama's delta, by the surface's delta.
struct BundleLinear {
  Eigen::Matrix2d whitener;
  Eigen::Vector2d residual;
  Matrix26d by_frame, by_panorama;
  Matrix23d by_surface;
};

// False where the point is behind the camera.
[[nodiscard]] bool LinearizeBundle(const BundleMatch& match, const CameraFrame& frame,
                                   const PanoramaMotion& panorama,
                                   const Eigen::Vector3d& surface_delta, BundleLinear* linear);

}  // namespace panofix
