#pragma once
// 2D-3D matches in a local metric frame, with what is known of their errors.

#include <Eigen/Core>
#include <vector>

#include "common/geometry/rigid3.h"

namespace panofix {

// One match of a frame's keypoint to a map point. "map" here is any metric frame near the vehicle.
struct Correspondence {
  Eigen::Vector2d bearing_in_cam = Eigen::Vector2d::Zero();  // undistorted (x/z, y/z)
  Eigen::Vector3d point_in_map = Eigen::Vector3d::Zero();    // metres
  // The point's error: rank one along the panorama's ray (depth), plus isotropic.
  Eigen::Vector3d range_sigma_in_map = Eigen::Vector3d::Zero();  // 1-sigma displacement, metres
  double point_sigma_m = 0;
  // The depth plane that the point lies on: its errors are shared by all its points, and are contained
  // in range_sigma_in_map. -1 = errors of its own only.
  int surface_id = -1;              // unique within one set of matches; belongs to one panorama
  Eigen::Vector3d surface_normal_in_map = Eigen::Vector3d::Zero();  // unit; zero = not known
  double surface_distance_sigma = 0;  // relative error of the plane's distance, 1 sigma
  double surface_normal_sigma_rad = 0;
  double keypoint_sigma = 1e-3;  // of the bearing, i.e. sigma_px / f
  int panorama_idx = -1;         // which panorama vouches for the point; -1 = none
  int view_idx = -1;             // which database view it was matched in
  // From the panorama's centre to the point, in map axes: what a shift of the panorama's pose acts
  // on.
  Eigen::Vector3d lever_in_map = Eigen::Vector3d::Zero();
};

// 2x2 covariance of the bearing residual at a pose: keypoint noise plus the point's covariance
// through the projection's Jacobian.
[[nodiscard]] Eigen::Matrix2d ResidualCovariance(const Correspondence& match,
                                                 const Rigid3& cam_from_map);

// Residual projection - bearing (normalised coordinates); false where the point is behind the
// camera (z < 0.1 m).
[[nodiscard]] bool BearingResidual(const Correspondence& match, const Rigid3& cam_from_map,
                                   Eigen::Vector2d* residual);

}  // namespace panofix
