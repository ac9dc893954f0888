#pragma once
// Geotags that are wrong by more than matching along known geometry bridges. Private to the module.

#include "builder/landmarks/layer_types.h"

namespace panofix {

// Compares neighbouring panoramas by their looks alone: where many matches agree on another
// relative pose (heading and shift, by RANSAC) than the geotags', one of the two is wrong; the one
// that disagrees with most neighbours. Returns, a panorama, how far off it seems to be (metres; 0 =
// nothing against it). Never blames a fixed one. Deterministic.
[[nodiscard]] std::vector<double> FindGeotagFaults(const LayerInput& input,
                                                   const MergedLandmarks& merged);

}  // namespace panofix
