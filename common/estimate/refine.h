#pragma once
// Robust refinement of a camera pose on SE(3), and its covariance (paper, Eqs. 5-6).

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "common/estimate/correspondence.h"
#include "common/geometry/rigid3.h"

namespace panofix {

// Tukey's biweight (paper, Eq. 6): t^2/6 (1 - (1 - (x/t)^2)^3) within t, t^2/6 beyond.
[[nodiscard]] double TukeyRho(double x, double t);
[[nodiscard]] double TukeyWeight(double x, double t);  // rho'(x)/x

// 6-vector order everywhere here: translation x y z (metres, map axes), then rotation x y z
// (radians, map axes): a perturbed pose is position + delta_t, map_from_cam = Exp(delta_r) *
// map_from_cam.
using Matrix6d = Eigen::Matrix<double, 6, 6>;

struct RefineOptions {
  double tukey_t = 4.6851;      // in sigmas of the whitened residual; 95 % efficiency
  double anneal_start = 4.0;    // first pass uses tukey_t times this, halved each pass to 1
  int max_iterations = 50;      // over all passes
  bool use_point_sigma = true;  // false: pixels only, the paper's
  // Optional prior on the camera's roll and pitch (gravity), radians 1-sigma; <= 0 is off. It says
  // that the map's z axis points along `up_in_cam`: the default is a level camera.
  double gravity_sigma_rad = 0;
  Eigen::Vector3d up_in_cam{0, -1, 0};
};

struct RefineResult {
  bool success = false;
  Rigid3 cam_from_map;
  Matrix6d covariance = Matrix6d::Zero();  // of the camera's pose in map axes, order above
  double chi2_per_dof = 0;                 // of the matches with weight > 0
  std::vector<double> weights;             // Tukey weight a match, [0, 1]
  int num_inliers = 0;                     // weight > 0
};

// Iteratively reweighted Levenberg-Marquardt with analytic Jacobians.
[[nodiscard]] RefineResult RefinePose(std::span<const Correspondence> matches,
                                      const Rigid3& cam_from_map, const RefineOptions& options);

// Jacobian (2x6) of the bearing residual in the 6-vector above; tested against finite differences.
[[nodiscard]] Eigen::Matrix<double, 2, 6> BearingJacobian(const Correspondence& match,
                                                          const Rigid3& cam_from_map);

struct PanoramaPrior {
  int panorama_idx = -1;
  double position_sigma_m = 0.05;
  double heading_sigma_rad = 0.002;
  double tilt_sigma_rad = 0.002;
};

struct BundleOptions {
  double tukey_t = 4.6851;
  int max_iterations = 30;
  // Of a past frame's matches that many are used, spread evenly over its list: the cost grows with
  // them, the gain soon does not.
  int max_matches_per_past_frame = 60;
};

// A frame that sees the panoramas. Its pose is a start for the newest frame and for past ones
// alike: nothing is taken from how well a past frame was known.
struct BundleFrame {
  Rigid3 cam_from_map;
  std::span<const Correspondence> matches;  // surface ids are shared by all frames
};

struct BundleResult {
  bool success = false;
  Rigid3 cam_from_map;
  // Marginal: the errors of panoramas and planes, and the other frames' poses, included.
  Matrix6d covariance = Matrix6d::Zero();
  std::vector<double> panorama_shift_m;  // one a prior, how far each panorama was moved
  double chi2_per_dof = 0;               // over all frames
  int num_inliers = 0;                   // of the newest frame
  int num_past_frames = 0;               // that took part
};

// The local bundle adjustment over all retrieved views (paper, section III-C): the poses of the
// last frames, newest last; a small 6-DoF correction of each panorama with its prior; three errors
// of each depth plane with theirs. Points move with their panorama and plane, their own error is in
// the residual's covariance. The answer is the newest frame's. Past frames see the same panoramas
// and planes from elsewhere, and so tell their errors from the pose; one whose matches mostly
// disagree with its pose is left out. Gauss-Newton with Tukey weights, Schur complements over
// panoramas; about 1 ms for 300 matches. Deterministic.
[[nodiscard]] BundleResult LocalBundleAdjustment(std::span<const BundleFrame> frames,
                                                 std::span<const PanoramaPrior> priors,
                                                 const BundleOptions& options);

// The same for one frame.
[[nodiscard]] BundleResult LocalBundleAdjustment(std::span<const Correspondence> matches,
                                                 const Rigid3& cam_from_map,
                                                 std::span<const PanoramaPrior> priors,
                                                 const BundleOptions& options);

}  // namespace panofix
