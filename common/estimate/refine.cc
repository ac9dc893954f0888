#include "common/estimate/refine.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "common/estimate/normal_equations.h"
#include "common/estimate/projection.h"

namespace panofix {
namespace {

constexpr std::size_t kMinMatches = 4;
// A thousandth of the best sigma that matches can give; the annealed passes need only come near.
constexpr double kStepTolerance_m = 1e-6;
constexpr double kStepTolerance_rad = 1e-7;
constexpr double kAnnealedTolerance = 100;  // times the above

// What a pass of annealing holds fixed while a step is judged: the whiteners at the pose it starts
// from.
struct Linearization {
  Matrix6d normal = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
  std::vector<Eigen::Matrix2d> whiteners;
  std::vector<double> norms;  // of the whitened residuals; infinite behind the camera
  double cost = 0;
};

class PoseRefiner {
 public:
  PoseRefiner(std::span<const Correspondence> matches, const RefineOptions& options)
      : matches_(matches), options_(options) {}

  // One pass at scale `t`; returns the iterations used. Stops at steps below `tolerance` times the
  // step tolerances.
  int Minimize(double t, double tolerance, int max_iterations, Rigid3* pose) const;
  [[nodiscard]] Linearization Linearize(const Rigid3& pose, double t) const;

 private:
  [[nodiscard]] Eigen::Matrix2d Whitener(const Correspondence& match,
                                         const Matrix23d& jacobian) const;
  [[nodiscard]] double Cost(const Rigid3& pose, const Linearization& at, double t) const;
  [[nodiscard]] bool HasGravity() const { return options_.gravity_sigma_rad > 0; }
  // Up in the camera, predicted minus measured, in sigmas: a chord, so its length is the tilt.
  [[nodiscard]] Eigen::Vector3d GravityResidual(const CameraFrame& frame) const {
    return (frame.cam_from_map_rotation.col(2) - options_.up_in_cam.normalized()) /
           options_.gravity_sigma_rad;
  }

  std::span<const Correspondence> matches_;
  const RefineOptions options_;
};

Eigen::Matrix2d PoseRefiner::Whitener(const Correspondence& match,
                                      const Matrix23d& jacobian) const {
  if (options_.use_point_sigma) return SqrtInformation(ResidualCovariance(match, jacobian));
  Correspondence pixels_only;
  pixels_only.keypoint_sigma = match.keypoint_sigma;
  return SqrtInformation(ResidualCovariance(pixels_only, jacobian));
}

Linearization PoseRefiner::Linearize(const Rigid3& pose, double t) const {
  Linearization at;
  at.whiteners.assign(matches_.size(), Eigen::Matrix2d::Zero());
  at.norms.assign(matches_.size(), std::numeric_limits<double>::infinity());
  const CameraFrame frame(pose);
  for (std::size_t i = 0; i < matches_.size(); ++i) {
    const Correspondence& match = matches_[i];
    const Eigen::Vector3d point = frame.ToCam(match.point_in_map);
    if (!IsFinite(match) || !(point.z() >= kMinDepth_m)) {
      at.cost += TukeyRho(2 * t, t);
      continue;
    }
    const Matrix23d point_jacobian = PointJacobian(frame, point);
    at.whiteners[i] = Whitener(match, point_jacobian);
    const Eigen::Vector2d residual =
        at.whiteners[i] * (point.head<2>() / point.z() - match.bearing_in_cam);
    const double norm = residual.norm();
    if (std::isfinite(norm)) at.norms[i] = norm;
    at.cost += TukeyRho(at.norms[i], t);
    const double weight = TukeyWeight(at.norms[i], t);
    if (weight <= 0) continue;
    const Matrix26d jacobian =
        at.whiteners[i] * PoseJacobian(point_jacobian, match.point_in_map - frame.position_in_map);
    at.normal.noalias() += weight * jacobian.transpose() * jacobian;
    at.gradient.noalias() += weight * jacobian.transpose() * residual;
  }
  if (HasGravity()) {
    const Eigen::Vector3d residual = GravityResidual(frame);
    const Eigen::Matrix3d jacobian =
        frame.cam_from_map_rotation * Skew(Eigen::Vector3d::UnitZ()) / options_.gravity_sigma_rad;
    at.normal.bottomRightCorner<3, 3>() += jacobian.transpose() * jacobian;
    at.gradient.tail<3>() += jacobian.transpose() * residual;
    at.cost += 0.5 * residual.squaredNorm();
  }
  return at;
}

double PoseRefiner::Cost(const Rigid3& pose, const Linearization& at, double t) const {
  double cost = 0;
  const CameraFrame frame(pose);
  for (std::size_t i = 0; i < matches_.size(); ++i) {
    // A match that was unusable where the whiteners were made costs the same in both poses.
    double norm = std::numeric_limits<double>::infinity();
    const Eigen::Vector3d point = frame.ToCam(matches_[i].point_in_map);
    if (std::isfinite(at.norms[i]) && point.z() >= kMinDepth_m) {
      norm = (at.whiteners[i] * (point.head<2>() / point.z() - matches_[i].bearing_in_cam)).norm();
    }
    cost += TukeyRho(norm, t);
  }
  if (HasGravity()) cost += 0.5 * GravityResidual(frame).squaredNorm();
  return cost;
}

int PoseRefiner::Minimize(double t, double tolerance, int max_iterations, Rigid3* pose) const {
  double damping = 1e-6;
  Linearization at = Linearize(*pose, t);
  for (int iteration = 1; iteration <= max_iterations; ++iteration) {
    Matrix6d damped = at.normal;
    damped.diagonal() *= 1 + damping;
    const Vector6d step = -damped.ldlt().solve(at.gradient);
    if (!step.allFinite()) return iteration;
    const Rigid3 candidate = PerturbPose(*pose, step);
    const bool small = step.head<3>().norm() < tolerance * kStepTolerance_m &&
                       step.tail<3>().norm() < tolerance * kStepTolerance_rad;
    if (Cost(candidate, at, t) <= at.cost) {
      *pose = candidate;
      if (small) return iteration;
      at = Linearize(*pose, t);
      damping = std::max(damping * 0.1, 1e-9);
    } else {
      damping *= 10;
      if (small || damping > 1e6) return iteration;
    }
  }
  return max_iterations;
}

}  // namespace

double TukeyRho(double x, double t) {
  const double bound = t * t / 6;
  if (!(std::abs(x) <= t)) return bound;
  const double u = 1 - (x / t) * (x / t);
  return bound * (1 - u * u * u);
}

double TukeyWeight(double x, double t) {
  if (!(t > 0) || !(std::abs(x) <= t)) return 0;
  const double u = 1 - (x / t) * (x / t);
  return u * u;
}

Eigen::Matrix<double, 2, 6> BearingJacobian(const Correspondence& match,
                                            const Rigid3& cam_from_map) {
  const CameraFrame frame(cam_from_map);
  return PoseJacobian(PointJacobian(frame, frame.ToCam(match.point_in_map)),
                      match.point_in_map - frame.position_in_map);
}

RefineResult RefinePose(std::span<const Correspondence> matches, const Rigid3& cam_from_map,
                        const RefineOptions& options) {
  RefineResult result;
  result.cam_from_map = cam_from_map;
  result.weights.assign(matches.size(), 0.0);
  const PoseRefiner refiner(matches, options);
  int left = std::max(options.max_iterations, 1);
  for (double factor = options.anneal_start; factor > 1 && left > 1; factor /= 2) {
    // Half of what is left, so that the last pass is never starved.
    left -= refiner.Minimize(factor * options.tukey_t, kAnnealedTolerance, left / 2,
                             &result.cam_from_map);
  }
  refiner.Minimize(options.tukey_t, 1, left, &result.cam_from_map);
  const Linearization at = refiner.Linearize(result.cam_from_map, options.tukey_t);
  double chi2 = 0;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    result.weights[i] = TukeyWeight(at.norms[i], options.tukey_t);
    if (result.weights[i] <= 0) continue;
    ++result.num_inliers;
    chi2 += at.norms[i] * at.norms[i];
  }
  if (static_cast<std::size_t>(result.num_inliers) < kMinMatches) return result;
  result.chi2_per_dof = chi2 / (2.0 * result.num_inliers - 6);
  const std::optional<Matrix6d> inverse = InvertInformation(at.normal);
  if (!inverse || !result.cam_from_map.translation.allFinite()) return result;
  // Residuals larger than their stated sigmas make the pose less certain; smaller ones prove
  // nothing.
  result.covariance = *inverse * std::max(1.0, result.chi2_per_dof);
  result.success = true;
  return result;
}

}  // namespace panofix
