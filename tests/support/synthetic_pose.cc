#include "tests/support/synthetic_pose.h"

#include <algorithm>
#include <cmath>

#include "common/geometry/attitude.h"

namespace panofix {
namespace {

// Somewhere on a street, upright within a few degrees, any heading.
Rigid3 RandomCamera(Rng* rng) {
  const Attitude attitude{rng->Uniform(0, 360), rng->Uniform(-5, 5), rng->Uniform(-5, 5)};
  const Eigen::Vector3d position(rng->Uniform(-200, 200), rng->Uniform(-200, 200),
                                 rng->Uniform(1, 3));
  return Rigid3(Eigen::Matrix3d(EnuFromBody(attitude) * BodyFromCam()), position).Inverse();
}

Eigen::Vector2d RandomBearing(const SyntheticPoseOptions& options, Rng* rng) {
  const double x_px = rng->Uniform(-0.5, 0.5) * options.width_px;
  const double y_px = rng->Uniform(-0.5, 0.5) * options.height_px;
  return Eigen::Vector2d(x_px, y_px) / options.focal_px;
}

// A true point, seen by the camera.
Eigen::Vector3d RandomPointInCam(const SyntheticPoseOptions& options, Rng* rng) {
  const Eigen::Vector2d bearing = RandomBearing(options, rng);
  if (options.layout == PointLayout::kLine) {
    // Half way into the depth range, across the image.
    const double depth_m = std::sqrt(options.min_depth_m * options.max_depth_m);
    return {bearing.x() * depth_m, 0.1 * depth_m + 0.2 * bearing.x() * depth_m, depth_m};
  }
  double depth_m = options.min_depth_m *
                   std::exp(rng->Uniform() * std::log(options.max_depth_m / options.min_depth_m));
  if (options.layout == PointLayout::kPlane) {
    // A facade at an angle to the optical axis: z = z0 + 0.7 x.
    depth_m = std::sqrt(options.min_depth_m * options.max_depth_m) / (1 - 0.7 * bearing.x());
  }
  return {bearing.x() * depth_m, bearing.y() * depth_m, depth_m};
}

}  // namespace

Eigen::Vector3d RandomNormal3(Rng* rng) {
  const double x = rng->Normal(), y = rng->Normal(), z = rng->Normal();
  return {x, y, z};
}

Eigen::Quaterniond RandomRotation(Rng* rng) {
  const Eigen::Vector3d axis = RandomNormal3(rng);
  return Eigen::Quaterniond(rng->Normal(), axis.x(), axis.y(), axis.z()).normalized();
}

SyntheticPose MakeSyntheticPose(const SyntheticPoseOptions& options, std::uint64_t seed) {
  Rng rng(seed, "tests/synthetic_pose");
  SyntheticPose world;
  world.cam_from_map = RandomCamera(&rng);
  const Rigid3 map_from_cam = world.cam_from_map.Inverse();
  std::vector<Eigen::Vector3d> centres;  // as the map has them
  for (int p = 0; p < options.num_panoramas; ++p) {
    const Eigen::Vector3d direction =
        map_from_cam.rotation * Eigen::Vector3d(rng.Normal(), 0, rng.Normal());
    centres.push_back(map_from_cam.translation + direction.normalized() * rng.Uniform(2, 8));
    PanoramaCorrection correction;
    correction.shift_m = options.panorama_position_sigma_m * RandomNormal3(&rng);
    correction.rotation_rad =
        Eigen::Vector3d(options.panorama_tilt_sigma_rad, options.panorama_tilt_sigma_rad,
                        options.panorama_heading_sigma_rad)
            .cwiseProduct(RandomNormal3(&rng));
    world.corrections.push_back(correction);
    world.priors.push_back({p, options.panorama_position_sigma_m,
                            options.panorama_heading_sigma_rad, options.panorama_tilt_sigma_rad});
  }
  for (int i = 0; i < options.num_matches; ++i) {
    const Eigen::Vector3d point_in_cam = RandomPointInCam(options, &rng);
    const Eigen::Vector3d point_in_map = map_from_cam * point_in_cam;
    Correspondence match;
    match.view_idx = i % (2 * std::max(options.num_panoramas, 1));
    // Exact matches still claim what a detector would.
    match.keypoint_sigma = (options.pixel_sigma > 0 ? options.pixel_sigma : 1.0) / options.focal_px;
    match.bearing_in_cam = point_in_cam.head<2>() / point_in_cam.z();
    const double noise_x = rng.Normal(), noise_y = rng.Normal();
    match.bearing_in_cam +=
        options.pixel_sigma / options.focal_px * Eigen::Vector2d(noise_x, noise_y);
    match.point_in_map = point_in_map;
    if (options.num_panoramas > 0) {
      match.panorama_idx =
          static_cast<int>(rng.Below(static_cast<std::uint64_t>(options.num_panoramas)));
      const auto p = static_cast<std::size_t>(match.panorama_idx);
      // Undo the panorama's correction: true = centre + shift + Exp(rotation) * lever.
      const Eigen::Vector3d lever = ExpSo3(-world.corrections[p].rotation_rad) *
                                    (point_in_map - centres[p] - world.corrections[p].shift_m);
      match.range_sigma_in_map = options.range_sigma_share * lever;
      match.lever_in_map = lever + match.range_sigma_in_map * rng.Normal();
      match.point_in_map = centres[p] + match.lever_in_map;
    }
    match.point_sigma_m = options.point_sigma_m;
    const Eigen::Vector3d offset = options.point_sigma_m * RandomNormal3(&rng);
    match.point_in_map += offset, match.lever_in_map += offset;
    const bool outlier = rng.Uniform() < options.outlier_share;
    if (outlier) match.bearing_in_cam = RandomBearing(options, &rng);
    world.is_outlier.push_back(outlier);
    world.matches.push_back(match);
  }
  return world;
}

Eigen::Matrix<double, 6, 1> PoseError(const Rigid3& estimated_cam_from_map,
                                      const Rigid3& true_cam_from_map) {
  const Rigid3 estimated = estimated_cam_from_map.Inverse(), truth = true_cam_from_map.Inverse();
  const Eigen::AngleAxisd rotation(estimated.rotation * truth.rotation.conjugate());
  const double angle = rotation.angle() > M_PI ? rotation.angle() - 2 * M_PI : rotation.angle();
  Eigen::Matrix<double, 6, 1> error;
  error << estimated.translation - truth.translation, rotation.axis() * angle;
  return error;
}

}  // namespace panofix
