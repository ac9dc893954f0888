#pragma once
// Synthetic frames with known truth: a camera on a street, points around it that panoramas vouch
// for, and the errors that the estimators claim to model, drawn from exactly that model.

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "common/base/rng.h"
#include "common/estimate/correspondence.h"
#include "common/estimate/refine.h"
#include "common/geometry/rigid3.h"

namespace panofix {

enum class PointLayout { kVolume, kPlane, kLine };

struct SyntheticPoseOptions {
  int num_matches = 200;
  double outlier_share = 0;  // of the matches: their bearing is anywhere in the image
  PointLayout layout = PointLayout::kVolume;
  double focal_px = 500;
  double width_px = 640, height_px = 480;
  double min_depth_m = 4, max_depth_m = 40;  // log-uniform
  double pixel_sigma = 0;                    // Gaussian keypoint noise; 0: exact, stated as 1 px
  double range_sigma_share = 0;              // of the range from the panorama
  double point_sigma_m = 0;
  int num_panoramas = 3;  // 2 to 8 m from the camera
  double panorama_position_sigma_m = 0;
  double panorama_heading_sigma_rad = 0;
  double panorama_tilt_sigma_rad = 0;
};

// What moves a panorama from where the map has it to where it is.
struct PanoramaCorrection {
  Eigen::Vector3d shift_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d rotation_rad = Eigen::Vector3d::Zero();
};

struct SyntheticPose {
  Rigid3 cam_from_map;                          // the truth
  std::vector<Correspondence> matches;          // as a program would see them
  std::vector<bool> is_outlier;                 // one a match
  std::vector<PanoramaPrior> priors;            // one a panorama; sigmas as drawn from
  std::vector<PanoramaCorrection> corrections;  // one a panorama, the truth
};

[[nodiscard]] SyntheticPose MakeSyntheticPose(const SyntheticPoseOptions& options,
                                              std::uint64_t seed);

// Uniform random rotation; a random unit vector.
[[nodiscard]] Eigen::Quaterniond RandomRotation(Rng* rng);
[[nodiscard]] Eigen::Vector3d RandomNormal3(Rng* rng);

// Error of an estimate in the 6-vector of refine.h: position, then rotation vector, map axes.
[[nodiscard]] Eigen::Matrix<double, 6, 1> PoseError(const Rigid3& estimated_cam_from_map,
                                                    const Rigid3& true_cam_from_map);

}  // namespace panofix
