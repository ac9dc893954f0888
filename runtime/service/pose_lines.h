#pragma once
// Poses as lines of text, for tools that know nothing of panofix.

#include <string>

#include "common/drive/poses_csv.h"

namespace panofix {

// NMEA 0183, each sentence ended by CR LF: GGA (quality 1 = fix, 6 = degraded, 0 = none), and where
// there is a pose HDT (heading) and GST (sigmas). Altitude is the row's height with geoid
// separation 0, so that their sum is the height above the ellipsoid.
[[nodiscard]] std::string ToNmea(const PoseRow& row);
// One GeoJSON Feature and a line break; its geometry is null where there is no pose.
[[nodiscard]] std::string ToGeoJsonLine(const PoseRow& row);

}  // namespace panofix
