// Local bundle adjustment. Ceres minimises over the deltas of bundle_residual.h; whiteners are held
// fixed within a pass and renewed between passes, as the refinement of one pose does.

#include <ceres/ceres.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <vector>

#include "common/estimate/bundle_residual.h"
#include "common/estimate/normal_equations.h"
#include "common/estimate/refine.h"

namespace panofix {
namespace {

constexpr double kMinPriorSigma = 1e-6;  // a prior of zero is a fixed panorama
constexpr std::array<double, 3> kAnnealing = {2, 1, 1};
constexpr int kMinMatches = 4;

using RowMatrix26d = Eigen::Matrix<double, 2, 6, Eigen::RowMajor>;

class BearingCost final : public ceres::CostFunction {
 public:
  BearingCost(const Correspondence& match, const Eigen::Matrix2d& whitener, const Rigid3& start,
              bool has_panorama)
      : match_(match), whitener_(whitener), start_(start), has_panorama_(has_panorama) {
    set_num_residuals(2);
    mutable_parameter_block_sizes()->assign(has_panorama ? 2 : 1, 6);
  }

  bool Evaluate(const double* const* parameters, double* residuals,
                double** jacobians) const override {
    const Vector6d frame_delta = Eigen::Map<const Vector6d>(parameters[0]);
    Vector6d panorama_delta = Vector6d::Zero();
    if (has_panorama_) panorama_delta = Eigen::Map<const Vector6d>(parameters[1]);
    Eigen::Vector2d residual;
    Matrix26d frame_jacobian, panorama_jacobian;
    if (!BundleResidual(match_, whitener_, start_, frame_delta, panorama_delta, &residual,
                        &frame_jacobian, &panorama_jacobian)) {
      residual.setConstant(kBehind);
      frame_jacobian.setZero(), panorama_jacobian.setZero();
    }
    Eigen::Map<Eigen::Vector2d>{residuals} = residual;
    if (jacobians == nullptr) return true;
    if (jacobians[0] != nullptr) Eigen::Map<RowMatrix26d>{jacobians[0]} = frame_jacobian;
    if (has_panorama_ && jacobians[1] != nullptr) {
      Eigen::Map<RowMatrix26d>{jacobians[1]} = panorama_jacobian;
    }
    return true;
  }

 private:
  static constexpr double kBehind = 1e3;  // sigmas: on the flat part of the loss
  const Correspondence match_;
  const Eigen::Matrix2d whitener_;
  const Rigid3 start_;
  const bool has_panorama_;
};

class PriorCost final : public ceres::SizedCostFunction<6, 6> {
 public:
  explicit PriorCost(const Vector6d& inverse_sigmas) : inverse_sigmas_(inverse_sigmas) {}
  bool Evaluate(const double* const* parameters, double* residuals,
                double** jacobians) const override {
    Eigen::Map<Vector6d>{residuals} =
        inverse_sigmas_.cwiseProduct(Eigen::Map<const Vector6d>(parameters[0]));
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      Eigen::Map<Matrix6d>{jacobians[0]} = inverse_sigmas_.asDiagonal();
    }
    return true;
  }

 private:
  const Vector6d inverse_sigmas_;
};

Vector6d InverseSigmas(const PanoramaPrior& prior) {
  const auto inverse = [](double sigma) {
    return 1 / (sigma > kMinPriorSigma ? sigma : kMinPriorSigma);
  };
  const double position = inverse(prior.position_sigma_m), tilt = inverse(prior.tilt_sigma_rad);
  Vector6d result;
  result << position, position, position, tilt, tilt, inverse(prior.heading_sigma_rad);
  return result;
}

class Bundle {
 public:
  Bundle(std::span<const Correspondence> matches, const Rigid3& start,
         std::span<const PanoramaPrior> priors, double tukey_t);
  [[nodiscard]] bool Minimize(double factor, int max_iterations);
  [[nodiscard]] BundleResult Result() const;

 private:
  [[nodiscard]] Rigid3 Pose() const { return PerturbPose(start_, frame_delta_); }
  [[nodiscard]] Vector6d PanoramaDelta(std::size_t match) const {
    return panorama_of_[match] < 0 ? Vector6d::Zero()
                                   : deltas_[static_cast<std::size_t>(panorama_of_[match])];
  }
  // Empty where the point is behind the camera as things stand.
  [[nodiscard]] std::optional<Eigen::Matrix2d> Whitener(std::size_t match) const;

  std::vector<Correspondence> matches_;
  std::vector<int> panorama_of_;  // of each match: index of its prior, -1 = held fixed
  std::vector<Vector6d> inverse_sigmas_;
  Rigid3 start_;
  double tukey_t_;
  Vector6d frame_delta_ = Vector6d::Zero();
  std::vector<Vector6d> deltas_;  // one a prior, contiguous: Ceres orders blocks by address
};

Bundle::Bundle(std::span<const Correspondence> matches, const Rigid3& start,
               std::span<const PanoramaPrior> priors, double tukey_t)
    : start_(start), tukey_t_(tukey_t), deltas_(priors.size(), Vector6d::Zero()) {
  for (const PanoramaPrior& prior : priors) inverse_sigmas_.push_back(InverseSigmas(prior));
  for (const Correspondence& match : matches) {
    if (!IsFinite(match)) continue;
    matches_.push_back(match);
    const auto prior = std::find_if(priors.begin(), priors.end(), [&](const PanoramaPrior& p) {
      return match.panorama_idx >= 0 && p.panorama_idx == match.panorama_idx;
    });
    panorama_of_.push_back(prior == priors.end() ? -1 : static_cast<int>(prior - priors.begin()));
  }
}

std::optional<Eigen::Matrix2d> Bundle::Whitener(std::size_t match) const {
  const CameraFrame frame(Pose());
  const Eigen::Vector3d point = frame.ToCam(MovedPoint(matches_[match], PanoramaDelta(match)));
  if (!(point.z() >= kMinDepth_m)) return std::nullopt;
  const Eigen::Matrix2d whitener =
      SqrtInformation(ResidualCovariance(matches_[match], PointJacobian(frame, point)));
  if (!whitener.allFinite()) return std::nullopt;
  return whitener;
}

bool Bundle::Minimize(double factor, int max_iterations) {
  // Declared before the problem that refers to it.
  ceres::TukeyLoss loss(factor * tukey_t_);
  ceres::Problem::Options problem_options;
  problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(problem_options);
  const Rigid3 pose = Pose();
  // Each pass starts its tangent anew at the pose it has.
  Vector6d delta = Vector6d::Zero();
  problem.AddParameterBlock(delta.data(), 6);
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (std::size_t i = 0; i < deltas_.size(); ++i) {
    problem.AddResidualBlock(new PriorCost(inverse_sigmas_[i]), nullptr, deltas_[i].data());
    ordering->AddElementToGroup(deltas_[i].data(), 0);
  }
  ordering->AddElementToGroup(delta.data(), 1);
  int used = 0;
  for (std::size_t i = 0; i < matches_.size(); ++i) {
    const std::optional<Eigen::Matrix2d> whitener = Whitener(i);
    if (!whitener) continue;
    ++used;
    std::vector<double*> blocks = {delta.data()};
    const int panorama = panorama_of_[i];
    if (panorama >= 0) blocks.push_back(deltas_[static_cast<std::size_t>(panorama)].data());
    problem.AddResidualBlock(new BearingCost(matches_[i], *whitener, pose, panorama >= 0), &loss,
                             blocks);
  }
  if (used < kMinMatches) return false;
  ceres::Solver::Options options;
  options.linear_solver_type = deltas_.empty() ? ceres::DENSE_QR : ceres::DENSE_SCHUR;
  options.linear_solver_ordering = ordering;
  options.num_threads = 1;
  options.max_num_iterations = max_iterations;
  options.logging_type = ceres::SILENT;
  options.function_tolerance = 1e-10;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  if (!summary.IsSolutionUsable() || !delta.allFinite()) return false;
  start_ = PerturbPose(pose, delta);
  frame_delta_.setZero();
  return true;
}

BundleResult Bundle::Result() const {
  BundleResult result;
  result.cam_from_map = Pose();
  Matrix6d information = Matrix6d::Zero();
  std::vector<Matrix6d> cross(deltas_.size(), Matrix6d::Zero()), own(deltas_.size());
  double chi2 = 0;
  for (std::size_t p = 0; p < deltas_.size(); ++p) {
    own[p] = inverse_sigmas_[p].cwiseAbs2().asDiagonal();
    chi2 += inverse_sigmas_[p].cwiseProduct(deltas_[p]).squaredNorm();
    result.panorama_shift_m.push_back(deltas_[p].head<3>().norm());
  }
  for (std::size_t i = 0; i < matches_.size(); ++i) {
    const std::optional<Eigen::Matrix2d> whitener = Whitener(i);
    Eigen::Vector2d residual;
    Matrix26d jacobian, panorama_jacobian;
    if (!whitener || !BundleResidual(matches_[i], *whitener, start_, frame_delta_, PanoramaDelta(i),
                                     &residual, &jacobian, &panorama_jacobian)) {
      continue;
    }
    const double weight = TukeyWeight(residual.norm(), tukey_t_);
    if (weight <= 0) continue;
    ++result.num_inliers;
    chi2 += residual.squaredNorm();
    information += weight * jacobian.transpose() * jacobian;
    if (panorama_of_[i] < 0) continue;
    const auto p = static_cast<std::size_t>(panorama_of_[i]);
    own[p] += weight * panorama_jacobian.transpose() * panorama_jacobian;
    cross[p] += weight * jacobian.transpose() * panorama_jacobian;
  }
  if (result.num_inliers < kMinMatches) return result;
  result.chi2_per_dof = chi2 / (2.0 * result.num_inliers - 6);  // a prior adds as many as it frees
  // Schur complement: what is left of the frame's information once the panoramas may move.
  for (std::size_t p = 0; p < deltas_.size(); ++p) {
    information -= cross[p] * own[p].ldlt().solve(cross[p].transpose());
  }
  const std::optional<Matrix6d> inverse =
      InvertInformation(0.5 * (information + information.transpose()));
  if (!inverse) return result;
  result.covariance = *inverse * std::max(1.0, result.chi2_per_dof);
  result.success = true;
  return result;
}

}  // namespace

BundleResult LocalBundleAdjustment(std::span<const Correspondence> matches,
                                   const Rigid3& cam_from_map,
                                   std::span<const PanoramaPrior> priors,
                                   const BundleOptions& options) {
  BundleResult failed;
  failed.cam_from_map = cam_from_map;
  failed.panorama_shift_m.assign(priors.size(), 0.0);
  if (!(options.tukey_t > 0) || !cam_from_map.translation.allFinite() ||
      !cam_from_map.rotation.coeffs().allFinite()) {
    return failed;
  }
  Bundle bundle(matches, cam_from_map, priors, options.tukey_t);
  const int iterations = std::max(1, options.max_iterations / static_cast<int>(kAnnealing.size()));
  for (const double factor : kAnnealing) {
    if (!bundle.Minimize(factor, iterations)) return failed;
  }
  return bundle.Result();
}

}  // namespace panofix
