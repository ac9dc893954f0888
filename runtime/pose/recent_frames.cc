#include "runtime/pose/recent_frames.h"

#include <tbb/parallel_for.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <optional>

#include "common/base/time_window.h"
#include "common/geometry/attitude.h"

namespace panofix {
namespace {

struct Posed {
  Rigid3 local_from_cam;
  const FrameFeatures& frame;
};

Eigen::Vector3d RayOf(const Posed& posed, std::size_t k) {
  const Eigen::Vector2d& b = posed.frame.bearings[k];
  return posed.local_from_cam.rotation * Eigen::Vector3d(b.x(), b.y(), 1).normalized();
}

// Roll of a camera: what its keypoints' angles are turned by against a level view's.
double RollDeg(const Rigid3& local_from_cam) {
  const Eigen::Vector3d up = local_from_cam.rotation.conjugate() * Eigen::Vector3d::UnitZ();
  return std::atan2(up.x(), -up.y()) / kRadPerDeg;
}

// A point on a keypoint's ray, and how much of its range is parallax.
struct Triangulated {
  double range_m = 0;
  double parallax_rad = 0;
};

// Where both rays come nearest, along the first (Hartley and Zisserman, Multiple View Geometry,
// 12.1: the midpoint method, one-sided since the first keypoint is the one that is kept).
std::optional<double> RangeAlong(const Eigen::Vector3d& ray, const Eigen::Vector3d& other_ray,
                                 const Eigen::Vector3d& to_other) {
  const double c = ray.dot(other_ray);
  const double sin_sq = 1 - c * c;
  if (sin_sq < 1e-8) return std::nullopt;
  return (ray.dot(to_other) - c * other_ray.dot(to_other)) / sin_sq;
}

// The partner frame of a pair, searched along epipolar lines.
class Partner {
 public:
  Partner(const Posed& newest, const Posed& older, const Camera& camera,
          const GuidedOptions& guided, const RecentOptions& options)
      : newest_(newest),
        older_(older),
        camera_(camera),
        guided_(guided),
        options_(options),
        grid_(older.frame.sift, camera),
        cam_from_local_(older.local_from_cam.Inverse()),
        turn_deg_(RollDeg(older.local_from_cam) - RollDeg(newest.local_from_cam)) {}

  [[nodiscard]] std::optional<Triangulated> Find(std::size_t k) const {
    const Eigen::Vector3d ray = RayOf(newest_, k);
    const Eigen::Vector3d& origin = newest_.local_from_cam.translation;
    const auto near = ProjectNearby(origin + options_.min_range_m * ray);
    const auto far = ProjectNearby(origin + options_.max_range_m * ray);
    if (!near || !far) return std::nullopt;
    const int match = Search(k, *near, *far);
    if (match < 0) return std::nullopt;
    const Eigen::Vector3d other_ray = RayOf(older_, static_cast<std::size_t>(match));
    const Eigen::Vector3d to_other = older_.local_from_cam.translation - origin;
    const auto range_m = RangeAlong(ray, other_ray, to_other);
    // Comparisons are written so that NaN fails.
    if (!range_m || !(*range_m >= options_.min_range_m && *range_m <= options_.max_range_m))
      return std::nullopt;
    const auto px = ProjectNearby(origin + *range_m * ray);
    const Keypoint& seen = older_.frame.sift.keypoints[static_cast<std::size_t>(match)];
    if (!px || !(std::hypot(px->x() - double{seen.x_px}, px->y() - double{seen.y_px}) <=
                 options_.max_reproj_error_px)) {
      return std::nullopt;
    }
    const double parallax_rad = std::acos(std::clamp(ray.dot(other_ray), -1.0, 1.0));
    if (!(parallax_rad >= options_.min_parallax_rad)) return std::nullopt;
    return Triangulated{*range_m, parallax_rad};
  }

 private:
  // In the older picture or within its size beside it: distortion is not to be believed farther
  // out.
  [[nodiscard]] std::optional<Eigen::Vector2d> ProjectNearby(const Eigen::Vector3d& point) const {
    const auto px = camera_.Project(cam_from_local_ * point);
    const bool is_near = px && px->x() > -camera_.width_px && px->x() < 2 * camera_.width_px &&
                         px->y() > -camera_.height_px && px->y() < 2 * camera_.height_px;
    return is_near ? px : std::nullopt;
  }
  // Keypoint of the older frame on the segment, or -1.
  [[nodiscard]] int Search(std::size_t k, const Eigen::Vector2d& near,
                           const Eigen::Vector2d& far) const {
    const Eigen::Vector2d along = far - near;
    const double length_px = along.norm();
    const Keypoint& keypoint = newest_.frame.sift.keypoints[k];
    thread_local std::vector<int> candidates;
    grid_.Within(
        0.5 * (near + far), 0.5 * length_px + options_.max_epipolar_px,
        ShapeLike(double{keypoint.size_px}, double{keypoint.angle_deg} + turn_deg_, guided_),
        &candidates);
    std::erase_if(candidates, [&](int c) {
      const Keypoint& other = older_.frame.sift.keypoints[static_cast<std::size_t>(c)];
      const Eigen::Vector2d d = Eigen::Vector2d(other.x_px, other.y_px) - near;
      const double t =
          length_px > 0 ? std::clamp(d.dot(along) / (length_px * length_px), 0.0, 1.0) : 0.0;
      return (d - t * along).norm() > options_.max_epipolar_px;
    });
    return BestOfWindow(older_.frame, candidates, newest_.frame.sift.descriptor(k).data(), guided_);
  }

  const Posed& newest_;
  const Posed& older_;
  const Camera& camera_;
  const GuidedOptions& guided_;
  const RecentOptions& options_;
  KeypointGrid grid_;
  Rigid3 cam_from_local_;
  double turn_deg_;
};

ReadyLandmark MakePoint(const Posed& newest, const Camera& camera, std::size_t k,
                        const Triangulated& at, const RecentOptions& options) {
  const Keypoint& keypoint = newest.frame.sift.keypoints[k];
  const Eigen::Vector3d lever = at.range_m * RayOf(newest, k);
  const double pixel_rad = KeypointSigma_px(keypoint.size_px) / camera.fx_px;
  ReadyLandmark point;
  point.match.point_in_map = newest.local_from_cam.translation + lever;
  point.match.lever_in_map = lever;
  point.match.panorama_idx = RecentPoints::kPanorama;
  point.match.point_sigma_m = pixel_rad * at.range_m;
  // What of the baseline makes the parallax: the part across the ray.
  const double share = std::hypot(std::sqrt(2.0) * pixel_rad / at.parallax_rad,
                                  options.pose_sigma_m / (at.range_m * at.parallax_rad));
  point.match.range_sigma_in_map = share * lever;
  point.id = static_cast<std::uint32_t>(k);
  point.size_m = static_cast<float>(double{keypoint.size_px} * at.range_m / camera.fx_px);
  point.angle_deg = static_cast<float>(double{keypoint.angle_deg} - RollDeg(newest.local_from_cam));
  point.up_in_local = Eigen::Vector3f::UnitZ();
  std::copy_n(newest.frame.sift.descriptor(k).data(), kDescriptorSize, point.descriptor.begin());
  return point;
}

PanoramaPrior PriorOf(const Matrix6d& covariance) {
  constexpr double kLeast_m = 0.005, kLeast_rad = 2e-4;
  PanoramaPrior prior;
  prior.panorama_idx = RecentPoints::kPanorama;
  // One figure for all axes: the worst one's.
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(covariance.topLeftCorner<3, 3>(),
                                                            Eigen::EigenvaluesOnly);
  prior.position_sigma_m = std::max(kLeast_m, std::sqrt(axes.eigenvalues().maxCoeff()));
  prior.heading_sigma_rad = std::max(kLeast_rad, std::sqrt(covariance(5, 5)));
  prior.tilt_sigma_rad = std::max(kLeast_rad, std::sqrt(covariance.block<2, 2>(3, 3).trace() / 2));
  return prior;
}

}  // namespace

void RecentFrames::Advance(std::int64_t now_ns) {
  ForgetOld(now_ns, options_.max_age_s, &keyframes_);
}

void RecentFrames::Add(std::int64_t now_ns, const Rigid3& map_from_cam, const PoseOutcome& outcome,
                       const FrameFeatures& frame) {
  if (!outcome.covariance.allFinite()) return;
  if (!keyframes_.empty() &&
      (map_from_cam.translation - keyframes_.back().map_from_cam.translation).norm() <
          options_.keyframe_step_m) {
    return;
  }
  keyframes_.push_back({now_ns, map_from_cam, outcome.covariance, outcome.unmapped_m, frame});
  if (keyframes_.size() > options_.max_keyframes) keyframes_.erase(keyframes_.begin());
}

RecentPoints RecentFrames::Triangulate(const Camera& camera, const LocalFrame& local,
                                       const GuidedOptions& guided) const {
  RecentPoints result;
  if (keyframes_.size() < 2) return result;
  const auto posed = [&](const Keyframe& k) {
    return Posed{Rigid3(k.map_from_cam.rotation, local.FromMap(k.map_from_cam.translation)),
                 k.frame};
  };
  const Posed newest = posed(keyframes_.back());
  std::vector<Posed> older;
  for (std::size_t i = 0; i + 1 < keyframes_.size(); ++i) {
    const Posed other = posed(keyframes_[i]);
    const double baseline_m =
        (other.local_from_cam.translation - newest.local_from_cam.translation).norm();
    if (baseline_m >= options_.min_baseline_m && baseline_m <= options_.max_baseline_m)
      older.push_back(other);
  }
  // Long baselines tell most and match least: some of each.
  std::vector<Partner> partners;
  const std::size_t most = std::min(older.size(), options_.max_partners);
  for (std::size_t i = 0; i < most; ++i)
    partners.emplace_back(newest, older[i * older.size() / most], camera, guided, options_);
  std::vector<std::optional<Triangulated>> found(newest.frame.sift.size());
  tbb::parallel_for(std::size_t{0}, found.size(), [&](std::size_t k) {
    for (const Partner& partner : partners) {
      const auto at = partner.Find(k);
      if (at && (!found[k] || at->parallax_rad > found[k]->parallax_rad)) found[k] = at;
    }
  });
  for (std::size_t k = 0; k < found.size(); ++k) {
    if (found[k]) result.points.push_back(MakePoint(newest, camera, k, *found[k], options_));
  }
  result.keyframe = PriorOf(keyframes_.back().covariance);
  result.unmapped_m = keyframes_.back().unmapped_m;
  result.cam_from_local = newest.local_from_cam.Inverse();
  return result;
}

}  // namespace panofix
