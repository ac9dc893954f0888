#include "common/estimate/normal_equations.h"

#include <Eigen/Eigenvalues>

#include "common/estimate/projection.h"

namespace panofix {
namespace {

// Rounding leaves about 1e-15 of a zero eigenvalue; a usable pose stays above 1e-9.
constexpr double kMinEigenvalue = 1e-11;

}  // namespace

std::optional<Matrix6d> InvertInformation(const Matrix6d& information) {
  if (!information.allFinite() || !(information.diagonal().minCoeff() > 0)) return std::nullopt;
  const Vector6d scale = information.diagonal().cwiseSqrt().cwiseInverse();
  const Matrix6d scaled = scale.asDiagonal() * information * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(scaled);
  if (solver.info() != Eigen::Success || !(solver.eigenvalues()[0] > kMinEigenvalue)) {
    return std::nullopt;
  }
  const Matrix6d inverse = solver.eigenvectors() *
                           solver.eigenvalues().cwiseInverse().asDiagonal() *
                           solver.eigenvectors().transpose();
  const Matrix6d covariance = scale.asDiagonal() * inverse * scale.asDiagonal();
  return Matrix6d(0.5 * (covariance + covariance.transpose()));
}

}  // namespace panofix
