#pragma once
// Variables, normal equations and cost of the local bundle adjustment.

#include <Eigen/Core>
#include <span>
#include <vector>

#include "common/estimate/bundle_residual.h"
#include "common/estimate/refine.h"

namespace panofix {

struct BundleState {
  std::vector<Rigid3> cam_from_map;             // one a frame, the newest last
  std::vector<Vector6d> panorama_deltas;        // one a prior
  std::vector<Eigen::Vector3d> surface_deltas;  // one a depth plane that is a variable
};

// One panorama with its surfaces: groups touch frames but not each other.
struct BundleGroup {
  Eigen::MatrixXd own;       // n x n, n = 6 + 3 a surface; lower triangle
  Eigen::MatrixXd cross;     // 6F x n
  Eigen::VectorXd gradient;  // n
};

// Gauss-Newton's system at a state, with the whiteners that its cost was made with.
struct BundleSystem {
  Eigen::MatrixXd frames;          // 6F x 6F, block diagonal
  Eigen::VectorXd frame_gradient;  // 6F
  std::vector<BundleGroup> groups;
  std::vector<Eigen::Matrix2d> whiteners;  // one a match
  std::vector<double> norms;               // of whitened residuals; infinite where unusable
  double cost = 0;
};

struct BundleStep {
  Eigen::VectorXd frames;               // 6F
  std::vector<Eigen::VectorXd> groups;  // n each
};

class BundleProblem {
 public:
  // Leaves out what is not finite, what exceeds the options' number of matches, and past frames
  // whose matches mostly disagree with their pose. Keeps copies of all.
  BundleProblem(std::span<const BundleFrame> frames, std::span<const PanoramaPrior> priors,
                const BundleOptions& options);

  [[nodiscard]] const BundleState& start() const { return start_; }
  [[nodiscard]] BundleSystem Linearize(const BundleState& state, double tukey_t) const;
  // Cost with the whiteners of `system`; a match that was unusable there costs the same everywhere.
  [[nodiscard]] double Cost(const BundleState& state, const BundleSystem& system,
                            double tukey_t) const;
  [[nodiscard]] BundleState Moved(const BundleState& state, const BundleStep& step) const;
  // Sum of squared sigmas by which the corrections left their priors.
  [[nodiscard]] double PriorChi2(const BundleState& state) const;
  [[nodiscard]] int num_frames() const { return static_cast<int>(start_.cam_from_map.size()); }
  [[nodiscard]] int frame_of(std::size_t match) const { return entries_[match].frame; }

 private:
  struct Entry {
    BundleMatch match;
    int frame = 0;
    int panorama = -1;  // index of its prior; -1 = held fixed
    int surface = -1;   // -1 = none that is a variable
  };
  // A depth plane with enough matches to be a variable of its own.
  struct Surface {
    int panorama = -1;  // index of its panorama's prior
    int column = 0;     // in its group
    Eigen::Vector3d inverse_sigmas = Eigen::Vector3d::Zero();
  };
  struct Motions;  // a state as the inner loops want it
  [[nodiscard]] Motions Prepare(const BundleState& state) const;

  void AddFrame(const BundleFrame& frame, std::span<const PanoramaPrior> priors, std::size_t most);
  void FindSurfaces();
  [[nodiscard]] BundleSystem PriorSystem(const BundleState& state) const;

  std::vector<Entry> entries_;
  std::vector<Vector6d> inverse_sigmas_;  // of the panoramas
  std::vector<int> group_sizes_;
  std::vector<Surface> surfaces_;
  BundleState start_;
};

}  // namespace panofix
