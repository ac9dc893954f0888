#pragma once
// The final point of a track. Private to the module.

#include <optional>

#include "builder/landmarks/joint_refinement.h"

namespace panofix {

struct TrackPoint {
  std::vector<LandmarkRef> members;             // that agree, at least two, ascending by panorama
  LandmarkRef anchor;                           // the member whose depth is nearest
  Eigen::Vector3d point_in_anchor;              // metres, in its panorama's frame as refined
  double range_sigma_m = 0, point_sigma_m = 0;  // along the anchor's ray; across, each axis
};

// Least squares over the bearings of all members and their depth planes (robust), poses and planes
// as refined, their remaining errors in the weights. Members whose bearing disagrees are dropped,
// the worst first; nullopt where fewer than two are left. Flagged panoramas take no part.
[[nodiscard]] std::optional<TrackPoint> TriangulateTrack(const LayerInput& input,
                                                         const MergedLandmarks& merged,
                                                         const JointRefinement& refinement,
                                                         const Track& track);

}  // namespace panofix
