#include "runtime/pose/pose_estimator.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <optional>
#include <stdexcept>

#include "common/base/log.h"
#include "runtime/pose/candidate.h"
#include "runtime/pose/gates.h"

namespace panofix {
namespace {

// A pose a view that reaches consensus, and one of all views together.
std::vector<Hypothesis> FindHypotheses(const std::vector<ViewMatches>& views, const MatchPool& pool,
                                       double focal_px, const PoseOptions& options) {
  std::vector<std::optional<Hypothesis>> found(views.size() + 1);
  tbb::parallel_for(std::size_t{0}, found.size(), [&](std::size_t i) {
    const bool all = i == views.size();
    RansacOptions ransac = options.ransac;
    if (all) ransac.minimal_solver = MinimalSolver::kP3p;
    const RansacResult result =
        EstimatePoseRansac(all ? pool.matches : views[i].correspondences, ransac);
    if (!result.success || static_cast<int>(result.inliers.size()) < options.min_view_inliers) {
      return;
    }
    found[i] = Hypothesis{result.cam_from_map, CountKeypoints(pool, result.cam_from_map, focal_px)};
  });
  std::vector<Hypothesis> hypotheses;
  for (const auto& hypothesis : found) {
    if (hypothesis) hypotheses.push_back(*hypothesis);
  }
  return hypotheses;
}

// The hypotheses worth a guided search: most keypoints first, near repeats left out, one where it
// is sure.
std::vector<Hypothesis> DistinctBest(std::vector<Hypothesis> hypotheses,
                                     const PoseOptions& options) {
  constexpr double kSamePlace_m = 0.7, kSameTurn_rad = 0.05;
  std::stable_sort(
      hypotheses.begin(), hypotheses.end(),
      [](const Hypothesis& a, const Hypothesis& b) { return a.num_keypoints > b.num_keypoints; });
  const bool one = !options.use_guided ||
                   (!hypotheses.empty() && hypotheses[0].num_keypoints >= options.sure_inliers);
  const std::size_t most = one ? 1 : static_cast<std::size_t>(options.max_candidates);
  std::vector<Hypothesis> distinct;
  for (const Hypothesis& h : hypotheses) {
    const bool repeat = std::any_of(distinct.begin(), distinct.end(), [&](const Hypothesis& d) {
      return (CentreOf(d.cam_from_local) - CentreOf(h.cam_from_local)).norm() < kSamePlace_m &&
             AngleBetween(d.cam_from_local.rotation, h.cam_from_local.rotation) < kSameTurn_rad;
    });
    if (!repeat) distinct.push_back(h);
    if (distinct.size() == most) break;
  }
  return distinct;
}

// The best supported candidate, gated.
PoseOutcome FindBest(const std::vector<ViewMatches>& views, const std::vector<Rigid3>& predictions,
                     const FrameFeatures& frame, const Camera& camera, const MapBundle& bundle,
                     const LocalFrame& local, const PoseOptions& options) {
  MatchPool pool;
  for (const ViewMatches& view : views) pool.Append(view);
  const std::vector<Hypothesis> hypotheses = FindHypotheses(views, pool, camera.fx_px, options);
  PoseOutcome best;
  best.covariance = Matrix6d::Zero();
  constexpr std::size_t kFewestMatches = 12;
  best.reason = pool.matches.size() < kFewestMatches ? "too_few_matches" : "no_consensus";
  const KeypointGrid grid(frame, camera);
  const Scene scene{frame, grid, camera, bundle, local};
  const auto elsewhere = [&](const Rigid3& pose, const Rigid3& from) {
    return (CentreOf(pose) - CentreOf(from)).norm() > options.elsewhere_m;
  };
  std::vector<PoseOutcome> candidates;
  const auto consider = [&](const Hypothesis& hypothesis) {
    PoseOutcome outcome = CompletePose(scene, hypothesis, pool, options);
    if (!outcome.found) return;
    for (const Hypothesis& h : hypotheses) {
      if (elsewhere(h.cam_from_local, outcome.cam_from_local)) {
        outcome.num_elsewhere = std::max(outcome.num_elsewhere, h.num_keypoints);
      }
    }
    outcome.reason = FailedGate(outcome, bundle, local, options);
    outcome.trusted = outcome.reason.empty();
    LogCandidate(outcome, bundle, local);
    candidates.push_back(outcome);
    if (std::make_tuple(outcome.trusted, outcome.support, outcome.num_inliers) >
        std::make_tuple(best.trusted, best.support, best.num_inliers)) {
      best = outcome;
    }
  };
  for (const Hypothesis& hypothesis : DistinctBest(hypotheses, options)) {
    consider(hypothesis);
    if (best.trusted && best.over_chance >= options.sure_over_chance) break;
  }
  for (std::size_t i = 0; i < predictions.size() && options.use_guided && !best.trusted; ++i) {
    consider({predictions[i], 0});
  }
  if (!best.trusted || !options.use_guided) return best;

  // Look-alikes: what would the landmarks of the other places say?
  const bool expected = std::any_of(predictions.begin(), predictions.end(), [&](const Rigid3& p) {
    return (CentreOf(p) - CentreOf(best.cam_from_local)).norm() < options.predicted_m;
  });
  if (expected) return best;
  int num_rivals = 0;
  for (const Hypothesis& h : hypotheses) {
    const bool known = std::any_of(candidates.begin(), candidates.end(), [&](const PoseOutcome& c) {
      return !elsewhere(h.cam_from_local, c.cam_from_local);
    });
    if (known || num_rivals == options.max_rivals) continue;
    ++num_rivals;
    consider(h);
  }
  for (const PoseOutcome& c : candidates) {
    if (elsewhere(c.cam_from_local, best.cam_from_local))
      best.rival_support = std::max(best.rival_support, c.support);
  }
  if (best.rival_support > options.max_rival_share * best.support) {
    best.trusted = false;
    best.reason = "ambiguous_place";
  }
  return best;
}

}  // namespace

void PoseOptions::Check() const {
  ransac.Check();
  if (min_view_inliers < 4) {
    throw std::invalid_argument(
        Format("min_view_inliers = %d; must be at least 4", min_view_inliers));
  }
  if (min_inliers < 6)
    throw std::invalid_argument(Format("min_inliers = %d; must be at least 6", min_inliers));
}

PoseOutcome EstimatePose(const std::vector<ViewMatches>& views,
                         const std::vector<Rigid3>& predictions, const FrameFeatures& frame,
                         const Camera& camera, const MapBundle& bundle, const LocalFrame& local,
                         const PoseOptions& options) {
  PoseOutcome best = FindBest(views, predictions, frame, camera, bundle, local, options);
  if (!best.trusted) return best;
  DegradeDoubtful(options, &best);
  return best;
}

}  // namespace panofix
