#pragma once
// The least-squares problem of the joint refinement. Private to the module.

#include <map>
#include <utility>

#include "builder/landmarks/plane_model.h"
#include "common/estimate/projection.h"

namespace panofix {

// A track as the solver sees it: its point lies on the ray of the member that is nearest to it.
struct JointTrack {
  LandmarkRef anchor;
  std::vector<LandmarkRef> others;
  double range = 1;  // of the point, as a multiple of the anchor's unrefined one
};
[[nodiscard]] JointTrack MakeJointTrack(const MergedLandmarks& merged, const Track& track);

using SurfaceRef = std::pair<std::uint32_t, std::uint8_t>;  // panorama, surface

// Where the refinement stands: starts at the geotags and the planes as given.
struct JointState {
  std::vector<Vector6d> corrections;             // [panorama]
  std::map<SurfaceRef, Eigen::Vector3d> planes;  // of the planes that enough tracks see
  std::vector<JointTrack> tracks;
};

// Minimises, over corrections of the panoramas that are not fixed, planes and ranges: bearings in
// the observing panoramas (robust: Cauchy, then Tukey's biweight annealed), distances from the
// planes (Cauchy: balconies), and the priors of `input.errors`. Ceres, one thread, points
// eliminated (Schur). Leaves the state as it is where nothing can be solved.
void SolveJointly(const LayerInput& input, const MergedLandmarks& merged, JointState* state);

// A member's bearing residual in a state.
struct BearingError {
  double px = 0;        // angle times focal length
  double whitened = 0;  // in sigmas, norm of two
};
[[nodiscard]] BearingError BearingErrorOf(const LayerInput& input, const MergedLandmarks& merged,
                                          const JointState& state, const JointTrack& track,
                                          LandmarkRef other);

// Information (1/m^2) that the bearings of a track hold on its range along the anchor's ray, poses
// held.
[[nodiscard]] double RangeInformation(const LayerInput& input, const MergedLandmarks& merged,
                                      const JointState& state, const JointTrack& track);

// What the members of a track know of their distance: relief is one and the same for all who see
// the point, so each counts for its share. Where the plane is no variable its error is added.
[[nodiscard]] DepthPrior JointDepthPrior(const LayerInput& input, const MergedLandmarks& merged,
                                         const JointTrack& track, LandmarkRef member,
                                         bool plane_is_variable);

}  // namespace panofix
