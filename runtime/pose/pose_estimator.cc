#include "runtime/pose/pose_estimator.h"

#include <algorithm>
#include <map>
#include <set>
#include <stdexcept>

#include "common/base/log.h"
#include "common/geometry/attitude.h"

namespace panofix {
namespace {

constexpr double kInlierChi2 = 9.21;  // 99 % of a 2-D whitened residual
// Never accept a residual beyond this, however uncertain the point is.
constexpr double kMaxReprojError_px = 12.0;

// Matches of all views, with their keypoints.
struct Pool {
  std::vector<Correspondence> matches;
  std::vector<int> keypoint_idx;
};

void Append(const ViewMatches& view, Pool* pool) {
  pool->matches.insert(pool->matches.end(), view.correspondences.begin(), view.correspondences.end());
  pool->keypoint_idx.insert(pool->keypoint_idx.end(), view.keypoint_idx.begin(), view.keypoint_idx.end());
}

bool Agrees(const Correspondence& match, const Rigid3& cam_from_local, double focal_px, double* chi2) {
  Eigen::Vector2d residual;
  if (!BearingResidual(match, cam_from_local, &residual)) return false;
  if (residual.norm() * focal_px > kMaxReprojError_px) return false;
  *chi2 = residual.dot(ResidualCovariance(match, cam_from_local).ldlt().solve(residual));
  return *chi2 < kInlierChi2;
}

int CountKeypoints(const Pool& pool, const Rigid3& cam_from_local, double focal_px) {
  std::set<int> keypoints;
  for (std::size_t i = 0; i < pool.matches.size(); ++i) {
    double chi2;
    if (Agrees(pool.matches[i], cam_from_local, focal_px, &chi2)) keypoints.insert(pool.keypoint_idx[i]);
  }
  return static_cast<int>(keypoints.size());
}

// Overlapping views of one panorama repeat a point: of each (keypoint, panorama) the match that agrees
// best stays, or its noise would count twice.
Pool WithoutRepeats(const Pool& pool, const Rigid3& cam_from_local, double focal_px) {
  std::map<std::pair<int, int>, std::pair<double, std::size_t>> best;
  for (std::size_t i = 0; i < pool.matches.size(); ++i) {
    double chi2 = 0;
    if (!Agrees(pool.matches[i], cam_from_local, focal_px, &chi2)) chi2 = 1e9;
    const auto key = std::make_pair(pool.keypoint_idx[i], pool.matches[i].panorama_idx);
    const auto [entry, is_new] = best.try_emplace(key, chi2, i);
    if (!is_new && chi2 < entry->second.first) entry->second = {chi2, i};
  }
  Pool kept;
  for (const auto& [key, value] : best) {
    kept.matches.push_back(pool.matches[value.second]);
    kept.keypoint_idx.push_back(pool.keypoint_idx[value.second]);
  }
  return kept;
}

struct Hypothesis {
  Rigid3 cam_from_local;
  int num_keypoints = 0;
};

Eigen::Vector3d CentreOf(const Rigid3& cam_from_local) { return cam_from_local.Inverse().translation; }

// A pose a view that reaches consensus, and one of all views together.
std::vector<Hypothesis> FindHypotheses(const std::vector<ViewMatches>& views, const Pool& pool,
                                       double focal_px, const PoseOptions& options) {
  std::vector<Hypothesis> hypotheses;
  RansacOptions ransac = options.ransac;
  const auto add = [&](const std::vector<Correspondence>& matches) {
    const RansacResult result = EstimatePoseRansac(matches, ransac);
    if (!result.success || static_cast<int>(result.inliers.size()) < options.min_view_inliers) return;
    hypotheses.push_back({result.cam_from_map, CountKeypoints(pool, result.cam_from_map, focal_px)});
  };
  for (const ViewMatches& view : views) add(view.correspondences);
  ransac.minimal_solver = MinimalSolver::kP3p;
  add(pool.matches);
  return hypotheses;
}

std::vector<PanoramaPrior> PriorsOf(const Pool& pool, const MapErrors& errors) {
  std::set<int> panoramas;
  for (const Correspondence& match : pool.matches) panoramas.insert(match.panorama_idx);
  std::vector<PanoramaPrior> priors;
  for (const int panorama : panoramas) {
    const double heading_rad = std::max(1e-4, errors.panorama_heading_sigma_deg * kRadPerDeg);
    priors.push_back({panorama, std::max(1e-3, errors.panorama_position_sigma_m), heading_rad, heading_rad});
  }
  return priors;
}

// Refines on all matches, then adjusts with the panoramas on those that agree.
struct Solution {
  bool success = false;
  Rigid3 cam_from_local;
  Matrix6d covariance = Matrix6d::Zero();
  double chi2_per_dof = 0;
};
Solution Solve(const Pool& pool, const Rigid3& start, double focal_px, const MapErrors& errors,
               const PoseOptions& options) {
  Solution solution;
  const Pool single = WithoutRepeats(pool, start, focal_px);
  const RefineResult refined = RefinePose(single.matches, start, options.refine);
  if (!refined.success) return solution;
  // Re-choose among repeats at the refined pose; only what agrees with it enters the adjustment.
  Pool agreed;
  const Pool chosen = WithoutRepeats(pool, refined.cam_from_map, focal_px);
  for (std::size_t i = 0; i < chosen.matches.size(); ++i) {
    double chi2;
    if (!Agrees(chosen.matches[i], refined.cam_from_map, focal_px, &chi2)) continue;
    agreed.matches.push_back(chosen.matches[i]);
    agreed.keypoint_idx.push_back(chosen.keypoint_idx[i]);
  }
  const BundleResult adjusted =
      LocalBundleAdjustment(agreed.matches, refined.cam_from_map, PriorsOf(agreed, errors), options.bundle);
  return {adjusted.success, adjusted.cam_from_map, adjusted.covariance, adjusted.chi2_per_dof};
}

// Counts what agrees with the final pose into the outcome.
void Summarize(const Pool& pool, const FrameFeatures& frame, const Camera& camera, PoseOutcome* outcome) {
  std::set<int> keypoints;
  std::map<int, int> inliers_of_view;
  for (std::size_t i = 0; i < pool.matches.size(); ++i) {
    double chi2;
    if (!Agrees(pool.matches[i], outcome->cam_from_local, camera.fx_px, &chi2)) continue;
    keypoints.insert(pool.keypoint_idx[i]);
    ++inliers_of_view[pool.matches[i].view_idx];
  }
  outcome->num_inliers = static_cast<int>(keypoints.size());
  std::vector<std::pair<int, int>> by_count;
  for (const auto& [view, count] : inliers_of_view) by_count.emplace_back(-count, view);
  std::sort(by_count.begin(), by_count.end());
  for (const auto& [count, view] : by_count) outcome->views.push_back(static_cast<std::uint32_t>(view));
  if (!outcome->views.empty()) outcome->best_view = outcome->views.front();
  std::vector<Eigen::Vector2d> inliers_px;
  for (const int k : keypoints) {
    const Keypoint& keypoint = frame.sift.keypoints[static_cast<std::size_t>(k)];
    inliers_px.emplace_back(keypoint.x_px, keypoint.y_px);
  }
  outcome->spread = ImageSpread(inliers_px, camera);
}

// The hypotheses worth a guided search: most keypoints first, near repeats left out, one where it is sure.
std::vector<Hypothesis> DistinctBest(std::vector<Hypothesis> hypotheses, const PoseOptions& options) {
  constexpr double kSamePlace_m = 0.7, kSameTurn_rad = 0.05;
  std::stable_sort(hypotheses.begin(), hypotheses.end(),
                   [](const Hypothesis& a, const Hypothesis& b) { return a.num_keypoints > b.num_keypoints; });
  const bool one = !options.use_guided || (!hypotheses.empty() && hypotheses[0].num_keypoints >= options.sure_inliers);
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

// Everything that a guided search needs beside the pose.
struct Scene {
  const FrameFeatures& frame;
  const KeypointGrid& grid;
  const Camera& camera;
  const MapBundle& bundle;
  const LocalFrame& local;
};

// Landmarks found beyond chance in windows of one size: comparable between poses.
int SupportAt(const Scene& scene, const Rigid3& cam_from_local, const PoseOptions& options) {
  GuidedOptions search = options.guided;
  search.min_radius_px = search.max_radius_px;
  const GuidedMatches found = MatchGuided(scene.frame, scene.grid, scene.camera, scene.bundle, scene.local,
                                          cam_from_local, Matrix6d::Zero(), search);
  return found.num_found - found.num_decoys;
}

// Steps sideways and along the line of sight to where more landmarks are found. Consensus on points of
// wrong depth (trees and cars before a façade) sits beside the right pose, not on it.
Rigid3 ClimbSupport(const Scene& scene, const Rigid3& start, const PoseOptions& options) {
  Rigid3 local_from_cam = start.Inverse();
  int best = SupportAt(scene, start, options);
  double step_m = options.climb_step_m;
  for (int climb = 0; climb < options.max_climbs; ++climb) {
    const Rigid3 centre = local_from_cam;
    for (const auto& [right, forward] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
      Rigid3 beside = centre;
      Eigen::Vector3d d = centre.rotation * Eigen::Vector3d(right, 0, forward);
      d.z() = 0;  // the road is no way up
      beside.translation += step_m * d;
      const int support = SupportAt(scene, beside.Inverse(), options);
      if (support > best) best = support, local_from_cam = beside;
    }
    if (local_from_cam.translation == centre.translation) {
      if (step_m < options.climb_step_m) break;
      step_m *= 0.5;
    }
  }
  return local_from_cam.Inverse();
}

// Guided rounds from a pose, each in windows half as wide, then the adjustment.
PoseOutcome GuidedRounds(const Scene& scene, const Pool& retrieved, Solution solution, const PoseOptions& options) {
  PoseOutcome outcome;
  outcome.covariance = Matrix6d::Zero();
  const MapErrors& errors = scene.bundle.manifest().errors;
  const double focal_px = scene.camera.fx_px;
  Pool pool = retrieved;
  for (int round = 0; options.use_guided && solution.success && round < options.guided_rounds; ++round) {
    GuidedOptions search = options.guided;
    // The first pose may be a metre off, whatever its covariance says: windows start wide and close in.
    const int rounds_left = options.guided_rounds - 1 - round;
    search.max_radius_px *= 1 << rounds_left;
    search.min_radius_px *= 1 << rounds_left;
    const GuidedMatches guided = MatchGuided(scene.frame, scene.grid, scene.camera, scene.bundle, scene.local,
                                             solution.cam_from_local, solution.covariance, search);
    pool = retrieved;
    for (const ViewMatches& view : guided.views) Append(view, &pool);
    if (rounds_left > 0) {
      // Consensus anew: a biased start would hold on to the matches that suit it.
      RansacOptions ransac = options.ransac;
      ransac.minimal_solver = MinimalSolver::kP3p;
      const RansacResult found = EstimatePoseRansac(pool.matches, ransac);
      if (found.success && CountKeypoints(pool, found.cam_from_map, focal_px) >
                               CountKeypoints(pool, solution.cam_from_local, focal_px)) {
        solution.cam_from_local = found.cam_from_map;
      }
    }
    outcome.support = double(guided.num_found - guided.num_decoys) / std::max(1, guided.num_visible);
    outcome.over_chance = double(guided.num_found) / std::max(1, guided.num_decoys);
    solution = Solve(pool, solution.cam_from_local, focal_px, errors, options);
  }
  if (!solution.success) return outcome;
  outcome.found = true;
  outcome.cam_from_local = solution.cam_from_local;
  outcome.covariance = solution.covariance;
  outcome.chi2_per_dof = solution.chi2_per_dof;
  Summarize(pool, scene.frame, scene.camera, &outcome);
  return outcome;
}

// From a hypothesis to a pose: refinement and guided rounds; where these leave doubt, once more from the
// best supported pose near by.
PoseOutcome Complete(const Scene& scene, const Hypothesis& hypothesis, const Pool& retrieved,
                     const PoseOptions& options) {
  Solution start = Solve(retrieved, hypothesis.cam_from_local, scene.camera.fx_px,
                         scene.bundle.manifest().errors, options);
  if (hypothesis.num_keypoints == 0) {
    // A prediction: no match speaks for it yet, so it is first brought to where landmarks are found.
    start = {true, ClimbSupport(scene, hypothesis.cam_from_local, options)};
  }
  PoseOutcome outcome = GuidedRounds(scene, retrieved, start, options);
  if (!options.use_guided || !outcome.found || outcome.over_chance >= options.sure_over_chance) return outcome;
  Solution beside = start;
  beside.cam_from_local = ClimbSupport(scene, outcome.cam_from_local, options);
  const PoseOutcome other = GuidedRounds(scene, retrieved, beside, options);
  return other.found && other.support > outcome.support ? other : outcome;
}

// Where the camera would be against the map's panoramas and a vehicle's attitude, or "".
std::string ImplausiblePlace(const Rigid3& local_from_cam, const MapBundle& bundle, const LocalFrame& local,
                             const PoseOptions& options) {
  double nearest_m = 1e9, height_off_m = 0;
  for (const MapPanorama& panorama : bundle.panoramas()) {
    const Eigen::Vector3d d = local_from_cam.translation - local.FromMap(panorama.map_from_pano.translation);
    if (d.head<2>().norm() < nearest_m) nearest_m = d.head<2>().norm(), height_off_m = std::abs(d.z());
  }
  if (nearest_m > options.max_distance_m) return "far_from_map";
  if (height_off_m > options.max_height_off_m) return "height_implausible";
  const Attitude attitude = AttitudeFromEnu(local_from_cam.rotation.toRotationMatrix() * BodyFromCam().transpose());
  if (std::abs(attitude.pitch_deg) > options.max_tilt_deg || std::abs(attitude.roll_deg) > options.max_tilt_deg) {
    return "tilt_implausible";
  }
  return "";
}

// The first gate that the pose fails, or "".
std::string FailedGate(const PoseOutcome& outcome, const MapBundle& bundle, const LocalFrame& local,
                       const PoseOptions& options) {
  if (outcome.num_inliers < options.min_inliers) return "too_few_inliers";
  if (outcome.spread < options.min_spread) return "inliers_clustered";
  if (outcome.num_inliers < options.min_lead * outcome.num_elsewhere) return "ambiguous_place";
  if (options.use_guided &&
      (outcome.support < options.min_support || outcome.over_chance < options.min_over_chance)) {
    return "landmarks_missing";
  }
  const double sigma_m = std::sqrt(outcome.covariance.topLeftCorner<2, 2>().trace());
  if (!(sigma_m < options.max_position_sigma_m)) return "pose_uncertain";
  if (outcome.chi2_per_dof > options.max_chi2_per_dof) return "residuals_too_large";
  return ImplausiblePlace(outcome.cam_from_local.Inverse(), bundle, local, options);
}

// For fitting gates: every candidate with what the gates look at.
void LogCandidate(const PoseOutcome& outcome, const MapBundle& bundle, const LocalFrame& local) {
  const Geodetic place = bundle.frame().ToGeodetic(local.ToMap(CentreOf(outcome.cam_from_local)));
  LogDebug(Format("candidate %.9f %.9f inliers %d elsewhere %d spread %.3f support %.3f over_chance %.1f "
                  "chi2 %.2f sigma_m %.3f %s",
                  place.lat_deg, place.lon_deg, outcome.num_inliers, outcome.num_elsewhere, outcome.spread,
                  outcome.support, outcome.over_chance, outcome.chi2_per_dof,
                  std::sqrt(outcome.covariance.topLeftCorner<2, 2>().trace()),
                  outcome.trusted ? "trusted" : outcome.reason.c_str()));
}

}  // namespace

void PoseOptions::Check() const {
  ransac.Check();
  if (min_view_inliers < 4) {
    throw std::invalid_argument(Format("min_view_inliers = %d; must be at least 4", min_view_inliers));
  }
  if (min_inliers < 6) throw std::invalid_argument(Format("min_inliers = %d; must be at least 6", min_inliers));
}

double ImageSpread(const std::vector<Eigen::Vector2d>& px, const Camera& camera) {
  if (px.size() < 3) return 0;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const auto& p : px) mean += p / static_cast<double>(px.size());
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
  for (const auto& p : px) covariance += (p - mean) * (p - mean).transpose() / static_cast<double>(px.size());
  const double uniform = camera.width_px * camera.height_px / 12.0;
  return std::sqrt(std::max(0.0, covariance.determinant())) / uniform;
}

PoseOutcome EstimatePose(const std::vector<ViewMatches>& views, const std::vector<Rigid3>& predictions,
                         const FrameFeatures& frame, const Camera& camera, const MapBundle& bundle,
                         const LocalFrame& local, const PoseOptions& options) {
  Pool pool;
  for (const ViewMatches& view : views) Append(view, &pool);
  const std::vector<Hypothesis> hypotheses = FindHypotheses(views, pool, camera.fx_px, options);
  PoseOutcome best;
  best.covariance = Matrix6d::Zero();
  constexpr std::size_t kFewestMatches = 12;
  best.reason = pool.matches.size() < kFewestMatches ? "too_few_matches" : "no_consensus";
  const KeypointGrid grid(frame, camera);
  const Scene scene{frame, grid, camera, bundle, local};
  const auto consider = [&](const Hypothesis& hypothesis) {
    PoseOutcome outcome = Complete(scene, hypothesis, pool, options);
    if (!outcome.found) return;
    for (const Hypothesis& h : hypotheses) {
      if ((CentreOf(h.cam_from_local) - CentreOf(outcome.cam_from_local)).norm() > options.elsewhere_m) {
        outcome.num_elsewhere = std::max(outcome.num_elsewhere, h.num_keypoints);
      }
    }
    outcome.reason = FailedGate(outcome, bundle, local, options);
    outcome.trusted = outcome.reason.empty();
    LogCandidate(outcome, bundle, local);
    if (std::make_tuple(outcome.trusted, outcome.support, outcome.num_inliers) >
        std::make_tuple(best.trusted, best.support, best.num_inliers)) {
      best = outcome;
    }
  };
  for (const Hypothesis& hypothesis : DistinctBest(hypotheses, options)) consider(hypothesis);
  for (std::size_t i = 0; i < predictions.size() && options.use_guided && !best.trusted; ++i) {
    consider({predictions[i], 0});
  }
  return best;
}

}  // namespace panofix
