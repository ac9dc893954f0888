#pragma once
// Web Mercator quadkeys: stable tile names that do not depend on the data set.

#include <string>

#include "common/geo/map_frame.h"

namespace panofix {

// About 200 m a side at 48 degrees of latitude: tens of panoramas a tile.
inline constexpr int kTileLevel = 17;

// Quadkey of the tile that holds a point, one digit 0..3 a level (Schwartz, "Bing Maps tile
// system"). Latitudes beyond the projection's 85.05 degrees fall in the outermost row.
[[nodiscard]] std::string Quadkey(const Geodetic& point, int level = kTileLevel);

}  // namespace panofix
