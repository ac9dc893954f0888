#pragma once
// Where panoramas stand on the map: the frame, their poses in it and their links.

#include <string>
#include <vector>

#include "builder/ingest/panorama_set.h"
#include "common/map/map_bundle.h"

namespace panofix {

// "tangent": the tangent cone at the panoramas' centroid; else a known grid. Throws
// Error(kNotFound).
[[nodiscard]] MapFrame ChooseFrame(const std::string& name,
                                   const std::vector<PanoramaRecord>& panoramas);

// Panoramas in the order given, with poses in map and links by index. A link holds both ways,
// whichever end states it; ids that are not in the set fall.
[[nodiscard]] std::vector<MapPanorama> PlacePanoramas(const std::vector<PanoramaRecord>& records,
                                                      const MapFrame& frame);

}  // namespace panofix
