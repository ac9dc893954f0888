#include "runtime/pose/bridge.h"

#include <algorithm>
#include <set>

#include "runtime/pose/candidate.h"
#include "runtime/pose/gates.h"

namespace panofix {
namespace {

constexpr std::size_t kFewestPoints = 100;
constexpr int kFewestInliers = 50;
constexpr double kLeastSupport = 0.2;  // of the points that must be in the picture
// From the keyframe: points are as deep as its baselines are long, and no step may outgrow them.
constexpr double kMostStep_m = 2;
constexpr double kMostShift_m = 1.5;  // from the prediction
constexpr double kMostTurn_rad = 0.25;
constexpr int kFewestOfMap = 12;         // landmarks of the map that end the drift
constexpr double kDriftShare = 0.03;     // of the way without them, 1 sigma: depths share errors
constexpr double kDriftTurn_rad = 1e-3;  // and a metre of it

// Matches of the recent points, then of the map, at a pose.
struct BridgeMatches {
  GuidedMatches recent, map;
};

BridgeMatches MatchBoth(const PoseContext& context, const KeypointGrid& grid,
                        const RecentPoints& recent, const Rigid3& cam_from_local) {
  const auto match = [&](const std::vector<ReadyLandmark>& landmarks) {
    return MatchGuided(context.frame, grid, context.camera, landmarks, cam_from_local,
                       Matrix6d::Zero(), context.options.guided);
  };
  return {match(recent.points),
          match(CollectLandmarks(context.bundle, context.stations, context.local, context.camera,
                                 cam_from_local, context.options.landmarks))};
}

// Consensus of the recent points around a prediction, refined.
RefineResult FindByRecent(const PoseContext& context, const KeypointGrid& grid,
                          const RecentPoints& recent, const Rigid3& prediction) {
  MatchPool pool;
  pool.Append(MatchAround(context.frame, grid, context.camera, recent.points, prediction,
                          context.options.around_px, context.options.guided));
  const RansacResult found = FindConsensus(pool, context.options);
  if (!found.success) return {};
  return RefinePose(pool.matches, found.cam_from_map, context.options.refine);
}

std::string FailedBridge(const PoseContext& context, const PoseOutcome& outcome,
                         const Rigid3& keyframe, const Rigid3& prediction) {
  const PoseOptions& options = context.options;
  if (outcome.num_inliers < kFewestInliers) return "too_few_inliers";
  // Comparisons are written so that NaN fails.
  if (!((CentreOf(outcome.cam_from_local) - CentreOf(keyframe)).norm() <= kMostStep_m))
    return "jump";
  if (!(outcome.spread >= options.min_spread)) return "inliers_clustered";
  // Beyond chance; how far over it says little: bricks lie near each other, and all agree.
  if (!(outcome.support >= kLeastSupport)) return "landmarks_missing";
  if (!(PositionSigma_m(outcome) < options.max_position_sigma_m)) return "pose_uncertain";
  if (!(outcome.chi2_per_dof <= options.max_chi2_per_dof)) return "residuals_too_large";
  if (!((CentreOf(outcome.cam_from_local) - CentreOf(prediction)).norm() <= kMostShift_m &&
        AngleBetween(outcome.cam_from_local.rotation, prediction.rotation) <= kMostTurn_rad)) {
    return "jump";
  }
  return ImplausiblePlace(outcome.cam_from_local.Inverse(), context.bundle, context.local, options);
}

// A few landmarks are found anywhere: what chance may have brought must not confirm a drift.
bool IsBeyondChance(const GuidedMatches& matches, const PoseOptions& options) {
  return matches.num_found - matches.num_decoys >= kFewestOfMap &&
         matches.num_found >= options.min_over_chance * matches.num_decoys;
}

// Errors of a row of triangulations add up along the way, not by their squares.
void AddDrift(const RecentPoints& recent, int num_of_map, PoseOutcome* outcome) {
  const double step_m =
      (CentreOf(outcome->cam_from_local) - CentreOf(recent.cam_from_local)).norm();
  const double before_m = recent.unmapped_m, now_m = before_m + step_m;
  const double grown = now_m * now_m - before_m * before_m;
  auto variances = outcome->covariance.diagonal().array();
  variances.head<3>() += kDriftShare * kDriftShare * grown;
  variances.tail<3>() += kDriftTurn_rad * kDriftTurn_rad * grown;
  outcome->unmapped_m = num_of_map >= kFewestOfMap ? 0 : now_m;
}

PoseOutcome Complete(const PoseContext& context, const KeypointGrid& grid,
                     const RecentPoints& recent, const Rigid3& start) {
  const double focal_px = context.camera.fx_px;
  PoseOutcome outcome;
  const BridgeMatches found = MatchBoth(context, grid, recent, start);
  MatchPool pool;
  pool.Append(found.recent.matches);
  pool = WithoutRepeats(pool, start, focal_px);
  const RefineResult refined = RefinePose(pool.matches, start, context.options.refine);
  if (!refined.success) return outcome;
  MatchPool agreed = Agreeing(pool, refined.cam_from_map, focal_px);
  MatchPool of_map;
  if (IsBeyondChance(found.map, context.options)) of_map.Append(found.map.matches);
  of_map = Agreeing(WithoutRepeats(of_map, refined.cam_from_map, focal_px), refined.cam_from_map,
                    focal_px);
  const std::set<int> keypoints(agreed.keypoint_idx.begin(), agreed.keypoint_idx.end());
  const std::set<int> map_keypoints(of_map.keypoint_idx.begin(), of_map.keypoint_idx.end());
  std::vector<PanoramaPrior> priors = PriorsOf(of_map, context.bundle.manifest().errors);
  priors.push_back(recent.keyframe);
  agreed.matches.insert(agreed.matches.end(), of_map.matches.begin(), of_map.matches.end());
  const BundleResult adjusted =
      LocalBundleAdjustment(agreed.matches, refined.cam_from_map, priors, context.options.bundle);
  if (!adjusted.success) return outcome;
  outcome.found = true;
  outcome.cam_from_local = adjusted.cam_from_map;
  outcome.covariance = adjusted.covariance;
  AddDrift(recent, static_cast<int>(map_keypoints.size()), &outcome);
  outcome.chi2_per_dof = adjusted.chi2_per_dof;
  outcome.num_inliers = static_cast<int>(keypoints.size());
  outcome.spread = KeypointSpread(keypoints, context.frame, context.camera);
  outcome.support = double(found.recent.num_found - found.recent.num_decoys) /
                    std::max(1, found.recent.num_visible);
  outcome.over_chance = double(found.recent.num_found) / std::max(1, found.recent.num_decoys);
  return outcome;
}

}  // namespace

PoseOutcome BridgePose(const PoseContext& context, const RecentPoints& recent,
                       const std::vector<Rigid3>& predictions) {
  PoseOutcome best;
  best.reason = "too_few_matches";
  if (recent.points.size() < kFewestPoints) return best;
  best.reason = "no_consensus";
  const KeypointGrid grid(context.frame.sift, context.camera);
  for (const Rigid3& prediction : predictions) {
    const RefineResult found = FindByRecent(context, grid, recent, prediction);
    if (!found.success) continue;
    PoseOutcome outcome = Complete(context, grid, recent, found.cam_from_map);
    if (!outcome.found) continue;
    outcome.station_distance_m =
        StationDistance_m(context.stations, context.local, outcome.cam_from_local);
    outcome.reason = FailedBridge(context, outcome, recent.cam_from_local, prediction);
    outcome.trusted = outcome.reason.empty();
    LogCandidate(outcome, context.bundle, context.local);
    if (outcome.trusted || outcome.num_inliers > best.num_inliers) best = outcome;
    if (best.trusted) break;
  }
  if (best.trusted) DegradeFarOrVague(context.options, &best);
  return best;
}

}  // namespace panofix
