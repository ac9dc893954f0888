#include "runtime/pose/paper_estimator.h"

#include <tbb/parallel_for.h>

#include <limits>
#include <map>
#include <optional>
#include <set>
#include <stdexcept>

#include "common/base/log.h"
#include "runtime/pose/match_pool.h"

namespace panofix {
namespace {

// A view's pose with the matches that carry it.
struct ViewPose {
  Rigid3 cam_from_local;
  ViewMatches inliers;
};

ViewMatches Select(const ViewMatches& all, const std::vector<int>& indices) {
  ViewMatches kept;
  kept.view_idx = all.view_idx;
  for (const int index : indices) {
    const auto i = static_cast<std::size_t>(index);
    kept.correspondences.push_back(all.correspondences[i]);
    kept.keypoint_idx.push_back(all.keypoint_idx[i]);
    kept.landmark_ids.push_back(all.landmark_ids[i]);
  }
  return kept;
}

std::optional<ViewPose> PoseFromView(const ViewMatches& matches, const PaperOptions& options) {
  const RansacResult found = EstimatePoseRansac(matches.correspondences, options.ransac);
  if (!found.success || static_cast<int>(found.inliers.size()) < options.min_inliers)
    return std::nullopt;
  ViewPose pose{found.cam_from_map, Select(matches, found.inliers)};
  const RefineResult refined =
      RefinePose(pose.inliers.correspondences, found.cam_from_map, options.refine);
  if (refined.success) pose.cam_from_local = refined.cam_from_map;
  return pose;
}

// Counts the keypoints that lie within the threshold of the final pose, and the views they are of.
void CountInliers(const MatchPool& pool, const RansacOptions& ransac, PoseOutcome* outcome) {
  std::set<int> keypoints;
  std::map<int, int> inliers_of_view;
  for (std::size_t i = 0; i < pool.matches.size(); ++i) {
    Eigen::Vector2d residual;
    if (!BearingResidual(pool.matches[i], outcome->cam_from_local, &residual) ||
        residual.norm() * ransac.focal_px > ransac.max_reproj_error_px) {
      continue;
    }
    keypoints.insert(pool.keypoint_idx[i]);
    ++inliers_of_view[pool.matches[i].view_idx];
  }
  outcome->num_inliers = static_cast<int>(keypoints.size());
  int most = 0;
  for (const auto& [view, count] : inliers_of_view) {
    outcome->views.push_back(static_cast<std::uint32_t>(view));
    if (count > most) most = count, outcome->best_view = outcome->views.back();
  }
}

}  // namespace

PaperOptions::PaperOptions() {
  ransac.minimal_solver = MinimalSolver::kEpnp;
  ransac.max_reproj_error_px = 3.0;
  ransac.local_optimizations = 0;
}

void PaperOptions::Check() const {
  match.Check();
  kvld.Check();
  ransac.Check();
  if (min_inliers < 6)
    throw std::invalid_argument(Format("min_inliers = %d; must be at least 6", min_inliers));
}

PaperMatcher::PaperMatcher(std::shared_ptr<const MapBundle> bundle, const Camera& camera,
                           const PaperOptions& options)
    : bundle_(std::move(bundle)),
      camera_(camera),
      options_(options),
      cache_(bundle_, options.max_cached_views) {
  options.Check();
  if (options.use_kvld && !bundle_->has_view_images()) {
    throw std::invalid_argument(
        "preset paper: the map keeps no view images, which kVLD compares; build it with "
        "--keep-view-images, or --add mutual");
  }
}

std::vector<ViewMatches> PaperMatcher::Match(const FrameFeatures& frame, const GrayImage& image,
                                             std::span<const std::uint32_t> views,
                                             const LocalFrame& local) {
  std::optional<GradientPyramid> pyramid;
  if (options_.use_kvld) pyramid.emplace(image);
  std::vector<ViewMatches> result(views.size());
  tbb::parallel_for(std::size_t{0}, views.size(), [&](std::size_t i) {
    result[i] = MatchView(frame, camera_, *bundle_, views[i], local, options_.match);
    if (pyramid) result[i] = KeepConsistent(result[i], frame, *pyramid, local);
    if (!options_.use_sigmas) result[i] = WithoutSigmas(std::move(result[i]), camera_.fx_px);
  });
  return result;
}

ViewMatches PaperMatcher::KeepConsistent(const ViewMatches& matches, const FrameFeatures& frame,
                                         const GradientPyramid& image, const LocalFrame& local) {
  const auto view_image = cache_.Get(matches.view_idx);
  if (!view_image.ok()) {
    LogWarning("view left out: " + view_image.status().message());
    return Select(matches, {});
  }
  // Each landmark is one keypoint of the view, however many match it.
  std::map<std::uint32_t, int> index_of;
  std::vector<std::uint32_t> ids;
  std::vector<FeatureMatch> pairs;
  for (std::size_t i = 0; i < matches.landmark_ids.size(); ++i) {
    const auto [entry, is_new] =
        index_of.try_emplace(matches.landmark_ids[i], static_cast<int>(ids.size()));
    if (is_new) ids.push_back(matches.landmark_ids[i]);
    pairs.push_back({matches.keypoint_idx[i], entry->second, 0});
  }
  return Select(matches, FilterKvld(image, frame.sift.keypoints, **view_image,
                                    KeypointsInView(*bundle_, matches.view_idx, ids, local), pairs,
                                    options_.kvld));
}

std::vector<Keypoint> KeypointsInView(const MapBundle& bundle, std::uint32_t view_idx,
                                      std::span<const std::uint32_t> ids, const LocalFrame& local) {
  const Camera camera = bundle.manifest().camera.WithoutDistortion();
  const Rigid3 view_from_local = PoseOfView(bundle, local, view_idx);
  std::vector<Keypoint> keypoints;
  for (const std::uint32_t id : ids) {
    const MapLandmark landmark = bundle.Landmark(id);
    const Eigen::Vector3d x_in_view =
        view_from_local *
        (local.LocalFromPano(bundle.panoramas()[landmark.panorama_idx]) * landmark.point_in_pano);
    constexpr double kNowhere = std::numeric_limits<double>::quiet_NaN();
    const Eigen::Vector2d px =
        camera.Project(x_in_view).value_or(Eigen::Vector2d(kNowhere, kNowhere));
    keypoints.push_back({static_cast<float>(px.x()), static_cast<float>(px.y()),
                         static_cast<float>(camera.fx_px * landmark.size_m / x_in_view.norm()),
                         static_cast<float>(landmark.angle_deg), 0});
  }
  return keypoints;
}

ViewMatches WithoutSigmas(ViewMatches matches, double focal_px) {
  for (Correspondence& match : matches.correspondences) {
    match.range_sigma_in_map.setZero();
    match.point_sigma_m = 0;
    match.surface_id = -1;
    match.surface_distance_sigma = match.surface_normal_sigma_rad = 0;
    match.keypoint_sigma = 1 / focal_px;
  }
  return matches;
}

PoseOutcome EstimatePaperPose(std::span<const ViewMatches> views, const MapErrors& errors,
                              const PaperOptions& options) {
  std::vector<std::optional<ViewPose>> poses(views.size());
  tbb::parallel_for(std::size_t{0}, views.size(),
                    [&](std::size_t i) { poses[i] = PoseFromView(views[i], options); });
  PoseOutcome outcome;
  outcome.reason = "no_consensus";
  MatchPool pool;
  std::size_t most = 0;
  Rigid3 start;
  for (const auto& pose : poses) {
    if (!pose) continue;
    pool.Append(pose->inliers);
    if (pose->inliers.keypoint_idx.size() > most)
      most = pose->inliers.keypoint_idx.size(), start = pose->cam_from_local;
  }
  if (most == 0) return outcome;
  // The views' own poses are given: fixed, unless their errors are to count.
  const std::vector<PanoramaPrior> priors =
      options.use_sigmas ? PriorsOf(pool, errors) : std::vector<PanoramaPrior>{};
  const BundleResult adjusted = LocalBundleAdjustment(pool.matches, start, priors, options.bundle);
  if (!adjusted.success) return outcome;
  outcome.found = true;
  outcome.cam_from_local = adjusted.cam_from_map;
  outcome.covariance = adjusted.covariance;
  outcome.chi2_per_dof = adjusted.chi2_per_dof;
  CountInliers(pool, options.ransac, &outcome);
  outcome.trusted = outcome.num_inliers >= options.min_inliers;
  outcome.reason = outcome.trusted ? "" : "too_few_inliers";
  return outcome;
}

}  // namespace panofix
