#include "runtime/pose/candidate.h"

#include <algorithm>
#include <map>
#include <set>

#include "common/geometry/attitude.h"

namespace panofix {
namespace {

// A pose on the way to the candidate.
struct Solution {
  bool success = false;
  Rigid3 cam_from_local;
  Matrix6d covariance = Matrix6d::Zero();
  double chi2_per_dof = 0;
  FocalCheck focal = {};
  std::vector<Correspondence> agreed = {};  // that the adjustment rests on
};

// Refines on all matches.
Solution Refine(const MatchPool& pool, const Rigid3& start, double focal_px,
                const PoseOptions& options) {
  const MatchPool single = WithoutRepeats(pool, start, focal_px);
  const RefineResult refined = RefinePose(single.matches, start, options.refine);
  return {refined.success, refined.cam_from_map, refined.covariance, refined.chi2_per_dof, {}};
}

// Refines, then adjusts with the panoramas and the past frames on those matches that agree.
Solution Adjust(const Scene& scene, const MatchPool& pool, const Rigid3& start,
                const PoseOptions& options) {
  const double focal_px = scene.camera.fx_px;
  const Solution refined = Refine(pool, start, focal_px, options);
  if (!refined.success) return refined;
  // Re-choose among repeats at the refined pose; only what agrees with it enters the adjustment.
  MatchPool agreed = Agreeing(WithoutRepeats(pool, refined.cam_from_local, focal_px),
                              refined.cam_from_local, focal_px);
  std::vector<PanoramaPrior> priors;  // none: panoramas are taken for exact
  std::vector<BundleFrame> frames;
  if (options.refine.use_point_sigma) {
    MatchPool all = agreed;
    for (const PastFrame& past : scene.past) {
      frames.push_back({past.cam_from_local, past.matches});
      all.matches.insert(all.matches.end(), past.matches.begin(), past.matches.end());
    }
    priors = PriorsOf(all, scene.bundle.manifest().errors);
  }
  frames.push_back({refined.cam_from_local, agreed.matches});
  const BundleResult adjusted = LocalBundleAdjustment(frames, priors, options.bundle);
  Solution solution{
      adjusted.success, adjusted.cam_from_map, adjusted.covariance, adjusted.chi2_per_dof, {}};
  if (solution.success)
    solution.focal = CheckFocal(agreed.matches, solution.cam_from_local, options.bundle.tukey_t);
  solution.agreed = std::move(agreed.matches);
  return solution;
}

// Counts what agrees with the final pose into the outcome.
void Summarize(const MatchPool& pool, const FrameFeatures& frame, const Camera& camera,
               PoseOutcome* outcome) {
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
  for (const auto& [count, view] : by_count)
    outcome->views.push_back(static_cast<std::uint32_t>(view));
  if (!outcome->views.empty()) outcome->best_view = outcome->views.front();
  outcome->spread = KeypointSpread(keypoints, frame, camera);
}

std::vector<ReadyLandmark> LandmarksAt(const Scene& scene, const Rigid3& cam_from_local,
                                       const PoseOptions& options, Reach reach = Reach::kNear) {
  LandmarkSetOptions set = options.landmarks;
  if (reach == Reach::kWide) set.num_stations = options.wide_stations;
  return CollectLandmarks(scene.bundle, scene.stations, scene.local, scene.camera, cam_from_local,
                          set);
}

// Landmarks found beyond chance in windows of one size: comparable between poses.
int SupportAt(const Scene& scene, const std::vector<ReadyLandmark>& landmarks,
              const Rigid3& cam_from_local, const PoseOptions& options) {
  GuidedOptions search = options.guided;
  search.min_radius_px = search.max_radius_px;
  const GuidedMatches found = MatchGuided(scene.frame, scene.grid, scene.camera, landmarks,
                                          cam_from_local, Matrix6d::Zero(), search);
  return found.num_found - found.num_decoys;
}

// Steps sideways and along the line of sight to where more landmarks are found. Consensus on points
// of wrong depth (trees and cars before a façade) sits beside the right pose, not on it.
Rigid3 ClimbSupport(const Scene& scene, const Rigid3& start, const PoseOptions& options) {
  Rigid3 local_from_cam = start.Inverse();
  const std::vector<ReadyLandmark> landmarks = LandmarksAt(scene, start, options);
  int best = SupportAt(scene, landmarks, start, options);
  double step_m = options.climb_step_m;
  for (int climb = 0; climb < options.max_climbs; ++climb) {
    const Rigid3 centre = local_from_cam;
    for (const auto& [right, forward] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
      Rigid3 beside = centre;
      Eigen::Vector3d d = centre.rotation * Eigen::Vector3d(right, 0, forward);
      d.z() = 0;  // the road is no way up
      beside.translation += step_m * d;
      const int support = SupportAt(scene, landmarks, beside.Inverse(), options);
      if (support > best) best = support, local_from_cam = beside;
    }
    if (local_from_cam.translation == centre.translation) {
      if (step_m < options.climb_step_m) break;
      step_m *= 0.5;
    }
  }
  return local_from_cam.Inverse();
}

// Consensus anew: a biased start would hold on to the matches that suit it.
void TryConsensus(const MatchPool& pool, double focal_px, const PoseOptions& options,
                  Rigid3* cam_from_local) {
  const RansacResult found = FindConsensus(pool, options);
  if (found.success && CountKeypoints(pool, found.cam_from_map, focal_px) >
                           CountKeypoints(pool, *cam_from_local, focal_px)) {
    *cam_from_local = found.cam_from_map;
  }
}

// Guided rounds from a pose, each in windows half as wide, then the adjustment.
PoseOutcome GuidedRounds(const Scene& scene, const MatchPool& retrieved, Solution solution,
                         const PoseOptions& options, Reach reach) {
  PoseOutcome outcome;
  const double focal_px = scene.camera.fx_px;
  MatchPool pool = retrieved;
  for (int round = 0; options.use_guided && solution.success && round < options.guided_rounds;
       ++round) {
    GuidedOptions search = options.guided;
    // The first pose may be a metre off, whatever its covariance says: windows start wide and close
    // in.
    const int rounds_left = options.guided_rounds - 1 - round;
    search.max_radius_px *= 1 << rounds_left;
    search.min_radius_px *= 1 << rounds_left;
    const auto find = [&](Reach how_far) {
      return MatchGuided(scene.frame, scene.grid, scene.camera,
                         LandmarksAt(scene, solution.cam_from_local, options, how_far),
                         solution.cam_from_local, solution.covariance, search);
    };
    const GuidedMatches guided = find(reach);
    pool = retrieved;
    pool.Append(guided.matches);
    if (rounds_left > 0) {
      TryConsensus(pool, focal_px, options, &solution.cam_from_local);
      solution = Refine(pool, solution.cam_from_local, focal_px, options);
      continue;
    }
    const GuidedMatches near = reach == Reach::kNear ? guided : find(Reach::kNear);
    outcome.support = double(near.num_found - near.num_decoys) / std::max(1, near.num_visible);
    outcome.over_chance = double(near.num_found) / std::max(1, near.num_decoys);
    outcome.coverage = SupportedShare(near);
    solution = Adjust(scene, pool, solution.cam_from_local, options);
    if (!solution.success) break;
    MatchPool found, of_near = reach == Reach::kNear ? retrieved : MatchPool{};
    found.Append(guided.matches);
    of_near.Append(near.matches);
    outcome.agreement =
        static_cast<double>(Agreeing(found, solution.cam_from_local, focal_px).matches.size()) /
        std::max(1, guided.num_found);
    outcome.num_near_inliers = CountKeypoints(of_near, solution.cam_from_local, focal_px);
  }
  if (!options.use_guided && solution.success)
    solution = Adjust(scene, pool, solution.cam_from_local, options);
  if (!solution.success) return outcome;
  outcome.found = true;
  outcome.cam_from_local = solution.cam_from_local;
  outcome.covariance = solution.covariance;
  outcome.chi2_per_dof = solution.chi2_per_dof;
  outcome.agreed = std::move(solution.agreed);
  outcome.num_firm =
      static_cast<int>(std::count_if(outcome.agreed.begin(), outcome.agreed.end(),
                                     [](const Correspondence& c) { return c.surface_id < 0; }));
  outcome.focal = solution.focal;
  Summarize(pool, scene.frame, scene.camera, &outcome);
  return outcome;
}

}  // namespace

double ImageSpread(const std::vector<Eigen::Vector2d>& px, const Camera& camera) {
  if (px.size() < 3) return 0;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const auto& p : px) mean += p / static_cast<double>(px.size());
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
  for (const auto& p : px)
    covariance += (p - mean) * (p - mean).transpose() / static_cast<double>(px.size());
  const double uniform = camera.width_px * camera.height_px / 12.0;
  return std::sqrt(std::max(0.0, covariance.determinant())) / uniform;
}

double KeypointSpread(const std::set<int>& keypoints, const FrameFeatures& frame,
                      const Camera& camera) {
  std::vector<Eigen::Vector2d> px;
  for (const int k : keypoints) {
    const Keypoint& keypoint = frame.sift.keypoints[static_cast<std::size_t>(k)];
    px.emplace_back(keypoint.x_px, keypoint.y_px);
  }
  return ImageSpread(px, camera);
}

PoseOutcome CompletePose(const Scene& scene, const Rigid3& cam_from_local,
                         const MatchPool& retrieved, const PoseOptions& options, Reach reach) {
  const Solution start = Refine(retrieved, cam_from_local, scene.camera.fx_px, options);
  PoseOutcome outcome = GuidedRounds(scene, retrieved, start, options, reach);
  if (!options.use_guided || !outcome.found || outcome.over_chance >= options.sure_over_chance)
    return outcome;
  Solution beside = start;
  beside.cam_from_local = ClimbSupport(scene, outcome.cam_from_local, options);
  const PoseOutcome other = GuidedRounds(scene, retrieved, beside, options, reach);
  return other.found && other.support > outcome.support ? other : outcome;
}

PoseBounds BoundsAround(const Rigid3& rough, double max_distance_m, const PoseOptions& options) {
  // Three matches fix a pose less well than all of them: what refits would bring in stays in.
  constexpr double kSlack = 2;
  return {rough, max_distance_m, kSlack * options.max_height_off_m,
          kSlack * options.max_tilt_deg * kRadPerDeg};
}

RansacResult FindConsensus(const MatchPool& pool, const PoseOptions& options,
                           const std::optional<PoseBounds>& bounds) {
  RansacOptions ransac = options.ransac;
  ransac.minimal_solver = MinimalSolver::kP3p;
  ransac.bounds = bounds;
  return EstimatePoseRansac(pool.matches, ransac);
}

MatchPool MatchNear(const Scene& scene, const Rigid3& cam_from_local, double radius_px,
                    const PoseOptions& options, Reach reach) {
  MatchPool pool;
  pool.Append(MatchAround(scene.frame, scene.grid, scene.camera,
                          LandmarksAt(scene, cam_from_local, options, reach), cam_from_local,
                          radius_px, options.guided));
  return pool;
}

}  // namespace panofix
