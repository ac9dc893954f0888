// Local bundle adjustment. Ceres minimises over the deltas of bundle_residual.h; whiteners are held
// fixed within a pass and renewed between passes, as the refinement of one pose does.

#include <ceres/ceres.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <utility>
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
using RowMatrix23d = Eigen::Matrix<double, 2, 3, Eigen::RowMajor>;

// Blocks: the frame's delta, then the panorama's and the surface's where they are variables.
class BearingCost final : public ceres::CostFunction {
 public:
  BearingCost(const Correspondence& match, const Eigen::Matrix2d& whitener, const Rigid3& start,
              bool has_panorama, bool has_surface)
      : match_(match), whitener_(whitener), start_(start), has_panorama_(has_panorama),
        has_surface_(has_surface) {
    set_num_residuals(2);
    mutable_parameter_block_sizes()->push_back(6);
    if (has_panorama) mutable_parameter_block_sizes()->push_back(6);
    if (has_surface) mutable_parameter_block_sizes()->push_back(3);
  }

  bool Evaluate(const double* const* parameters, double* residuals,
                double** jacobians) const override {
    const std::size_t surface_block = has_panorama_ ? 2 : 1;
    const Vector6d frame_delta = Eigen::Map<const Vector6d>(parameters[0]);
    Vector6d panorama_delta = Vector6d::Zero();
    Eigen::Vector3d surface_delta = Eigen::Vector3d::Zero();
    if (has_panorama_) panorama_delta = Eigen::Map<const Vector6d>(parameters[1]);
    if (has_surface_) surface_delta = Eigen::Map<const Eigen::Vector3d>(parameters[surface_block]);
    Eigen::Vector2d residual;
    Matrix26d frame_jacobian, panorama_jacobian;
    Matrix23d surface_jacobian;
    if (!BundleResidual(match_, whitener_, start_, frame_delta, panorama_delta, surface_delta,
                        &residual, &frame_jacobian, &panorama_jacobian, &surface_jacobian)) {
      residual.setConstant(kBehind);
      frame_jacobian.setZero(), panorama_jacobian.setZero(), surface_jacobian.setZero();
    }
    Eigen::Map<Eigen::Vector2d>{residuals} = residual;
    if (jacobians == nullptr) return true;
    if (jacobians[0] != nullptr) Eigen::Map<RowMatrix26d>{jacobians[0]} = frame_jacobian;
    if (has_panorama_ && jacobians[1] != nullptr) {
      Eigen::Map<RowMatrix26d>{jacobians[1]} = panorama_jacobian;
    }
    if (has_surface_ && jacobians[surface_block] != nullptr) {
      Eigen::Map<RowMatrix23d>{jacobians[surface_block]} = surface_jacobian;
    }
    return true;
  }

 private:
  static constexpr double kBehind = 1e3;  // sigmas: on the flat part of the loss
  const Correspondence match_;
  const Eigen::Matrix2d whitener_;
  const Rigid3 start_;
  const bool has_panorama_, has_surface_;
};

// A Gaussian prior at zero on a block of N.
template <int N>
class PriorCost final : public ceres::SizedCostFunction<N, N> {
 public:
  using Vector = Eigen::Matrix<double, N, 1>;
  explicit PriorCost(const Vector& inverse_sigmas) : inverse_sigmas_(inverse_sigmas) {}
  bool Evaluate(const double* const* parameters, double* residuals,
                double** jacobians) const override {
    Eigen::Map<Vector>{residuals} =
        inverse_sigmas_.cwiseProduct(Eigen::Map<const Vector>(parameters[0]));
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      Eigen::Map<Eigen::Matrix<double, N, N>>{jacobians[0]} = inverse_sigmas_.asDiagonal();
    }
    return true;
  }

 private:
  const Vector inverse_sigmas_;
};

double Inverse(double sigma) { return 1 / (sigma > kMinPriorSigma ? sigma : kMinPriorSigma); }

Vector6d InverseSigmas(const PanoramaPrior& prior) {
  const double position = Inverse(prior.position_sigma_m), tilt = Inverse(prior.tilt_sigma_rad);
  Vector6d result;
  result << position, position, position, tilt, tilt, Inverse(prior.heading_sigma_rad);
  return result;
}

// A depth plane with enough matches to be a variable of its own.
struct Surface {
  int panorama = -1;  // index of its panorama's prior
  Eigen::Vector3d inverse_sigmas = Eigen::Vector3d::Zero();
};

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
  [[nodiscard]] Eigen::Vector3d SurfaceDelta(std::size_t match) const {
    return surface_of_[match] < 0 ? Eigen::Vector3d::Zero()
                                  : surface_deltas_[static_cast<std::size_t>(surface_of_[match])];
  }
  void FindSurfaces();
  [[nodiscard]] Matrix6d MarginalInformation(BundleResult* result, double* chi2) const;
  // Empty where the point is behind the camera as things stand.
  [[nodiscard]] std::optional<Eigen::Matrix2d> Whitener(std::size_t match) const;

  std::vector<Correspondence> matches_;
  std::vector<int> panorama_of_;  // of each match: index of its prior, -1 = held fixed
  std::vector<int> surface_of_;   // of each match: index of its surface, -1 = none
  std::vector<Vector6d> inverse_sigmas_;
  std::vector<Surface> surfaces_;
  Rigid3 start_;
  double tukey_t_;
  Vector6d frame_delta_ = Vector6d::Zero();
  // One a prior and one a surface, contiguous: Ceres orders blocks by address.
  std::vector<Vector6d> deltas_;
  std::vector<Eigen::Vector3d> surface_deltas_;
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
  FindSurfaces();
}

void Bundle::FindSurfaces() {
  constexpr int kFewestOnSurface = 3;  // fewer cannot show what they share
  std::map<int, int> count, index_of;
  for (std::size_t i = 0; i < matches_.size(); ++i) {
    if (matches_[i].surface_id >= 0 && panorama_of_[i] >= 0) ++count[matches_[i].surface_id];
  }
  surface_of_.assign(matches_.size(), -1);
  for (std::size_t i = 0; i < matches_.size(); ++i) {
    Correspondence& match = matches_[i];
    const bool has_shared = match.surface_distance_sigma > 0 || match.surface_normal_sigma_rad > 0;
    if (panorama_of_[i] < 0 || match.surface_id < 0 || !has_shared || count[match.surface_id] < kFewestOnSurface) {
      continue;
    }
    const auto [entry, is_new] = index_of.try_emplace(match.surface_id, static_cast<int>(surfaces_.size()));
    if (is_new) {
      const double tilt = Inverse(match.surface_normal_sigma_rad);
      surfaces_.push_back({panorama_of_[i], {Inverse(match.surface_distance_sigma), tilt, tilt}});
    }
    surface_of_[i] = entry->second;
    match = WithoutSharedError(match);
  }
  surface_deltas_.assign(surfaces_.size(), Eigen::Vector3d::Zero());
}

std::optional<Eigen::Matrix2d> Bundle::Whitener(std::size_t match) const {
  const CameraFrame frame(Pose());
  const Eigen::Vector3d point = frame.ToCam(MovedPoint(matches_[match], PanoramaDelta(match), SurfaceDelta(match)));
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
    problem.AddResidualBlock(new PriorCost<6>(inverse_sigmas_[i]), nullptr, deltas_[i].data());
    ordering->AddElementToGroup(deltas_[i].data(), surfaces_.empty() ? 0 : 1);
  }
  // Surfaces know nothing of each other: they are eliminated first.
  for (std::size_t i = 0; i < surfaces_.size(); ++i) {
    problem.AddResidualBlock(new PriorCost<3>(surfaces_[i].inverse_sigmas), nullptr, surface_deltas_[i].data());
    ordering->AddElementToGroup(surface_deltas_[i].data(), 0);
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
    const int surface = surface_of_[i];
    if (surface >= 0) blocks.push_back(surface_deltas_[static_cast<std::size_t>(surface)].data());
    problem.AddResidualBlock(
        new BearingCost(matches_[i], *whitener, pose, panorama >= 0, surface >= 0), &loss, blocks);
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

// Information of the frame once each panorama, with its surfaces, may move (Schur complement). A panorama
// and its surfaces form one dense block; blocks of different panoramas do not touch.
Matrix6d Bundle::MarginalInformation(BundleResult* result, double* chi2) const {
  std::vector<int> column_of(surfaces_.size());  // of a surface within its panorama's block
  std::vector<int> size(deltas_.size(), 6);
  for (std::size_t k = 0; k < surfaces_.size(); ++k) {
    column_of[k] = std::exchange(size[static_cast<std::size_t>(surfaces_[k].panorama)],
                                 size[static_cast<std::size_t>(surfaces_[k].panorama)] + 3);
  }
  std::vector<Eigen::MatrixXd> own(deltas_.size()), cross(deltas_.size());
  for (std::size_t p = 0; p < deltas_.size(); ++p) {
    own[p] = Eigen::MatrixXd::Zero(size[p], size[p]);
    cross[p] = Eigen::MatrixXd::Zero(6, size[p]);
    own[p].diagonal().head<6>() = inverse_sigmas_[p].cwiseAbs2();
  }
  for (std::size_t k = 0; k < surfaces_.size(); ++k) {
    own[static_cast<std::size_t>(surfaces_[k].panorama)].diagonal().segment<3>(column_of[k]) =
        surfaces_[k].inverse_sigmas.cwiseAbs2();
  }
  Matrix6d information = Matrix6d::Zero();
  for (std::size_t i = 0; i < matches_.size(); ++i) {
    const std::optional<Eigen::Matrix2d> whitener = Whitener(i);
    Eigen::Vector2d residual;
    Matrix26d jacobian, panorama_jacobian;
    Matrix23d surface_jacobian;
    if (!whitener || !BundleResidual(matches_[i], *whitener, start_, frame_delta_, PanoramaDelta(i),
                                     SurfaceDelta(i), &residual, &jacobian, &panorama_jacobian,
                                     &surface_jacobian)) {
      continue;
    }
    const double weight = TukeyWeight(residual.norm(), tukey_t_);
    if (weight <= 0) continue;
    ++result->num_inliers;
    *chi2 += residual.squaredNorm();
    information += weight * jacobian.transpose() * jacobian;
    if (panorama_of_[i] < 0) continue;
    const auto p = static_cast<std::size_t>(panorama_of_[i]);
    Eigen::MatrixXd block = Eigen::MatrixXd::Zero(2, size[p]);
    block.leftCols<6>() = panorama_jacobian;
    if (surface_of_[i] >= 0) {
      block.middleCols<3>(column_of[static_cast<std::size_t>(surface_of_[i])]) = surface_jacobian;
    }
    own[p] += weight * block.transpose() * block;
    cross[p] += weight * jacobian.transpose() * block;
  }
  for (std::size_t p = 0; p < deltas_.size(); ++p) {
    information -= cross[p] * own[p].ldlt().solve(cross[p].transpose());
  }
  return 0.5 * (information + information.transpose());
}

BundleResult Bundle::Result() const {
  BundleResult result;
  result.cam_from_map = Pose();
  double chi2 = 0;
  for (std::size_t p = 0; p < deltas_.size(); ++p) {
    chi2 += inverse_sigmas_[p].cwiseProduct(deltas_[p]).squaredNorm();
    result.panorama_shift_m.push_back(deltas_[p].head<3>().norm());
  }
  for (std::size_t k = 0; k < surfaces_.size(); ++k) {
    chi2 += surfaces_[k].inverse_sigmas.cwiseProduct(surface_deltas_[k]).squaredNorm();
  }
  const Matrix6d information = MarginalInformation(&result, &chi2);
  if (result.num_inliers < kMinMatches) return result;
  result.chi2_per_dof = chi2 / (2.0 * result.num_inliers - 6);  // a prior adds as many as it frees
  const std::optional<Matrix6d> inverse = InvertInformation(information);
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
