#pragma once
// Panorama poses and depth planes that suit what all panoramas see. Private to the module.

#include "builder/landmarks/plane_model.h"

namespace panofix {

struct JointRefinement {
  std::vector<PanoramaRefinement> panoramas;
  std::vector<std::vector<Eigen::Vector3d>> plane_deltas;  // [panorama][surface]; see PlaneModel
  std::vector<double> fault_m;  // [panorama] how far off a flagged one may be; 0 = not flagged
  std::vector<double> pose_error_left;  // [panorama] share of the geotag's sigmas
};

// As nothing were known but the geotags: what a layer without refinement has, and where one with
// it starts from. Panoramas with a fault are flagged.
[[nodiscard]] JointRefinement Unrefined(const LayerInput& input,
                                        const std::vector<double>& fault_m);

// Refines over a spread selection of the tracks (every plane has its say; poses need no more).
// Panoramas that would have to move beyond the limits, or whose bearings stay bad, are flagged,
// left where they are and their bearings unused, and the rest is solved again.
[[nodiscard]] JointRefinement RefineJointly(const LayerInput& input, const MergedLandmarks& merged,
                                            const std::vector<Track>& tracks,
                                            const std::vector<double>& fault_m);

}  // namespace panofix
