// Local bundle adjustment: Levenberg-Marquardt with Tukey weights over the problem of
// bundle_problem.h. Whiteners are held fixed while a step is judged, and renewed with each step.

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <optional>

#include "common/estimate/bundle_problem.h"
#include "common/estimate/normal_equations.h"
#include "common/estimate/refine.h"

namespace panofix {
namespace {

constexpr int kMinMatches = 4;
// Passes: scale of Tukey's bound, and the step, in sigmas of all variables together, below which
// the pass ends.
struct Pass {
  double factor, step_sigmas;
};
constexpr Pass kPasses[] = {{2, 0.1}, {1, 1e-3}};

// The frames' system once panoramas and surfaces may move (Schur complement), with what brings the
// frames' step back to them.
struct Reduced {
  Eigen::MatrixXd frames;
  Eigen::VectorXd gradient;
  std::vector<Eigen::MatrixXd> back;          // inverse(own) * cross^T
  std::vector<Eigen::VectorXd> own_gradient;  // inverse(own) * gradient
};

Reduced EliminateGroups(const BundleSystem& system, double damping) {
  Reduced reduced{system.frames, system.frame_gradient, {}, {}};
  reduced.frames.diagonal() *= 1 + damping;
  for (const BundleGroup& group : system.groups) {
    Eigen::MatrixXd own = group.own;
    own.diagonal() *= 1 + damping;
    const Eigen::LDLT<Eigen::MatrixXd> solver(own);  // reads the lower triangle
    reduced.back.push_back(solver.solve(group.cross.transpose()));
    reduced.own_gradient.push_back(solver.solve(group.gradient));
    reduced.frames.noalias() -= group.cross * reduced.back.back();
    reduced.gradient.noalias() -= group.cross * reduced.own_gradient.back();
  }
  return reduced;
}

BundleStep Solve(const BundleSystem& system, double damping) {
  const Reduced reduced = EliminateGroups(system, damping);
  BundleStep step;
  step.frames = -reduced.frames.ldlt().solve(reduced.gradient);
  for (std::size_t p = 0; p < system.groups.size(); ++p)
    step.groups.push_back(-reduced.own_gradient[p] - reduced.back[p] * step.frames);
  return step;
}

// Length of a step in sigmas: step^T H step = -gradient^T step. Not finite where the step is not.
double Sigmas(const BundleSystem& system, const BundleStep& step) {
  double square = -system.frame_gradient.dot(step.frames);
  for (std::size_t p = 0; p < system.groups.size(); ++p)
    square -= system.groups[p].gradient.dot(step.groups[p]);
  return std::isfinite(square) ? std::sqrt(std::max(0.0, square)) : square;
}

// Returns the iterations used.
int Minimize(const BundleProblem& problem, double tukey_t, double step_sigmas, int max_iterations,
             BundleState* state) {
  constexpr double kFirstDamping = 1e-6, kLeastDamping = 1e-9, kMostDamping = 1e6;
  double damping = kFirstDamping;
  BundleSystem system = problem.Linearize(*state, tukey_t);
  for (int iteration = 1; iteration <= max_iterations; ++iteration) {
    const BundleStep step = Solve(system, damping);
    const double sigmas = Sigmas(system, step);
    if (!std::isfinite(sigmas) || !step.frames.allFinite()) return iteration;
    BundleState moved = problem.Moved(*state, step);
    if (problem.Cost(moved, system, tukey_t) <= system.cost) {
      *state = std::move(moved);
      if (sigmas < step_sigmas) return iteration;
      system = problem.Linearize(*state, tukey_t);
      damping = std::max(damping * 0.1, kLeastDamping);
    } else {
      damping *= 10;
      if (sigmas < step_sigmas || damping > kMostDamping) return iteration;
    }
  }
  return max_iterations;
}

// Information of the newest frame with everything else free.
Matrix6d NewestInformation(const BundleSystem& system) {
  const Eigen::MatrixXd frames = EliminateGroups(system, 0).frames;
  const Eigen::Index past = frames.rows() - 6;
  Matrix6d information = frames.bottomRightCorner<6, 6>();
  if (past > 0) {
    const Eigen::MatrixXd cross = frames.bottomLeftCorner(6, past);
    information -= cross * frames.topLeftCorner(past, past).ldlt().solve(cross.transpose());
  }
  return 0.5 * (information + information.transpose());
}

// Fills all but the pose; false where too little is left of the newest frame.
bool Summarize(const BundleProblem& problem, const BundleState& state, double tukey_t,
               BundleResult* result) {
  const BundleSystem system = problem.Linearize(state, tukey_t);
  for (std::size_t p = 0; p < state.panorama_deltas.size(); ++p)
    result->panorama_shift_m[p] = state.panorama_deltas[p].head<3>().norm();
  std::vector<int> inliers(state.cam_from_map.size());
  double chi2 = problem.PriorChi2(state);
  for (std::size_t i = 0; i < system.norms.size(); ++i) {
    if (TukeyWeight(system.norms[i], tukey_t) <= 0) continue;
    ++inliers[static_cast<std::size_t>(problem.frame_of(i))];
    chi2 += system.norms[i] * system.norms[i];
  }
  result->num_inliers = inliers.back();
  if (result->num_inliers < kMinMatches) return false;
  int freedom = 0;  // a prior adds as many as it frees
  for (const int n : inliers) freedom += std::max(0, 2 * n - 6);
  result->chi2_per_dof = chi2 / freedom;
  const std::optional<Matrix6d> inverse = InvertInformation(NewestInformation(system));
  if (!inverse) return false;
  result->covariance = *inverse * std::max(1.0, result->chi2_per_dof);
  return true;
}

}  // namespace

BundleResult LocalBundleAdjustment(std::span<const BundleFrame> frames,
                                   std::span<const PanoramaPrior> priors,
                                   const BundleOptions& options) {
  BundleResult result;
  result.panorama_shift_m.assign(priors.size(), 0.0);
  if (frames.empty()) return result;
  result.cam_from_map = frames.back().cam_from_map;
  if (!(options.tukey_t > 0) || !result.cam_from_map.translation.allFinite() ||
      !result.cam_from_map.rotation.coeffs().allFinite()) {
    return result;
  }
  const BundleProblem problem(frames, priors, options);
  BundleState state = problem.start();
  int left = std::max(options.max_iterations, 2);
  for (const Pass& pass : kPasses) {
    // Half of what is left, so that the last pass is never starved.
    const int most = pass.factor > 1 ? left / 2 : left;
    left -= Minimize(problem, pass.factor * options.tukey_t, pass.step_sigmas, most, &state);
  }
  if (!state.cam_from_map.back().translation.allFinite()) return result;
  result.num_past_frames = problem.num_frames() - 1;
  result.success = Summarize(problem, state, options.tukey_t, &result);
  if (result.success) result.cam_from_map = state.cam_from_map.back();
  return result;
}

BundleResult LocalBundleAdjustment(std::span<const Correspondence> matches,
                                   const Rigid3& cam_from_map,
                                   std::span<const PanoramaPrior> priors,
                                   const BundleOptions& options) {
  const BundleFrame frame{cam_from_map, matches};
  return LocalBundleAdjustment({&frame, 1}, priors, options);
}

}  // namespace panofix
