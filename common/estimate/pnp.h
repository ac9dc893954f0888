#pragma once
// Absolute pose from 2D-3D matches: minimal solver, EPnP, robust search.

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "common/estimate/correspondence.h"
#include "common/geometry/rigid3.h"

namespace panofix {

// All poses cam_from_map (at most 4) that put three points on three unit rays: P3P by Grunert's
// distance equations with a polished quartic (Haralick et al., "Review and analysis of solutions of
// the three point perspective pose estimation problem", IJCV 1994). Empty for degenerate triangles.
[[nodiscard]] std::vector<Rigid3> SolveP3p(const std::array<Eigen::Vector3d, 3>& rays_in_cam,
                                           const std::array<Eigen::Vector3d, 3>& points_in_map);

// EPnP (Lepetit, Moreno-Noguer, Fua, IJCV 2009; OpenCV's) from 4 or more matches; false where it
// fails.
[[nodiscard]] bool SolveEpnp(std::span<const Correspondence> matches, Rigid3* cam_from_map);

enum class MinimalSolver { kP3p, kEpnp };

// What is known of a pose before the search, in a map frame whose z is up. The bound on tilt is a
// gravity prior.
struct PoseBounds {
  Rigid3 cam_from_map;      // roughly
  double max_distance_m;    // of the camera from there, across the ground
  double max_height_off_m;  // above or below
  double max_tilt_rad;      // between the verticals, as the camera sees them
  [[nodiscard]] bool Hold(const Rigid3& pose_cam_from_map) const;
};

struct RansacOptions {
  MinimalSolver minimal_solver = MinimalSolver::kP3p;  // kEpnp draws 5: the paper's EPnP-RANSAC
  double max_reproj_error_px = 3.0;                    // inlier threshold in pixels
  double focal_px = 500;                               // turns it into normalised units
  int min_iterations = 50;
  int max_iterations = 2000;            // bound on time
  double success_probability = 0.9999;  // ends early once an all-inlier sample is this likely
  int min_inliers = 6;                  // below it there is no pose
  int local_optimizations = 4;          // LO-RANSAC rounds on each new best; 0 = plain RANSAC
  std::optional<PoseBounds> bounds;     // samples' poses beyond them are left out
  std::uint64_t seed = 1;
  void Check() const;  // throws std::invalid_argument naming field, value, rule
};

struct RansacResult {
  bool success = false;
  Rigid3 cam_from_map;
  std::vector<int> inliers;  // indices into the matches, ascending
  int iterations = 0;
};

// LO-RANSAC (Chum, Matas, Kittler 2003) with MSAC scoring; deterministic for a seed. Fewer than 4
// matches or no consensus is an outcome, not an error. Never throws on data.
[[nodiscard]] RansacResult EstimatePoseRansac(std::span<const Correspondence> matches,
                                              const RansacOptions& options);

}  // namespace panofix
