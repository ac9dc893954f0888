#pragma once
// Which landmarks go on the map. Private to the module.

#include "builder/landmarks/layer_types.h"

namespace panofix {

// Keeps a landmark while one of the views that show it has fewer than `max_per_view`; those that
// several panoramas saw first, then those that many views show, then the strongest. 0 keeps all.
// The order is kept.
[[nodiscard]] std::vector<Landmark> SelectLandmarks(std::vector<MergedLandmark> landmarks,
                                                    int max_per_view);

}  // namespace panofix
