#include "common/estimate/focal_check.h"

#include <Eigen/Cholesky>
#include <cmath>

#include "common/estimate/refine.h"

namespace panofix {

FocalCheck CheckFocal(std::span<const Correspondence> matches, const Rigid3& cam_from_map,
                      double tukey_t) {
  using Matrix7d = Eigen::Matrix<double, 7, 7>;
  using Vector7d = Eigen::Matrix<double, 7, 1>;
  Matrix7d normal = Matrix7d::Zero();
  Vector7d gradient = Vector7d::Zero();
  double chi2 = 0;
  int num_used = 0;
  for (const Correspondence& match : matches) {
    Eigen::Vector2d residual;
    if (!BearingResidual(match, cam_from_map, &residual)) continue;
    const Eigen::Matrix2d information =
        ResidualCovariance(match, cam_from_map).ldlt().solve(Eigen::Matrix2d::Identity());
    const double square = residual.dot(information * residual);
    const double weight = TukeyWeight(std::sqrt(square), tukey_t);
    if (!(weight > 0) || !information.allFinite()) continue;
    Eigen::Matrix<double, 2, 7> jacobian;
    // The bearing is the pixel over the focal length: a longer one shrinks it.
    jacobian << BearingJacobian(match, cam_from_map), match.bearing_in_cam;
    normal += weight * jacobian.transpose() * information * jacobian;
    gradient += weight * jacobian.transpose() * information * residual;
    chi2 += weight * square;
    ++num_used;
  }
  FocalCheck check;
  constexpr int kFewest = 8;
  if (num_used < kFewest) return check;
  // Metres and radians do not compare.
  const Vector7d scale = normal.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Eigen::LDLT<Matrix7d> solver(scale.asDiagonal() * normal * scale.asDiagonal());
  constexpr double kLeastPivot = 1e-10;
  if (solver.info() != Eigen::Success || !(solver.vectorD().minCoeff() > kLeastPivot)) return check;
  const Vector7d scaled_gradient = scale.asDiagonal() * gradient;
  const Vector7d step = -(scale.asDiagonal() * solver.solve(scaled_gradient));
  Vector7d unit = Vector7d::Zero();
  unit(6) = scale(6);
  const double variance = scale(6) * solver.solve(unit)(6);
  const double dof = std::max(1.0, 2.0 * num_used - 7);
  if (!(variance > 0) || !step.allFinite()) return check;
  return {step(6), std::sqrt(variance * std::max(1.0, chi2 / dof))};
}

}  // namespace panofix
