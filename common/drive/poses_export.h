#pragma once
// The sister formats of poses.csv. Rows without a pose are left out of all of them.

#include <string>
#include <vector>

#include "common/drive/poses_csv.h"

namespace panofix {

// TUM (evo): "seconds x y z qx qy qz qw" of cam in the east-north-up frame of the first pose.
[[nodiscard]] std::string FormatTum(const std::vector<PoseRow>& rows);
// RFC 7946: one Point feature a pose, the other columns as properties.
[[nodiscard]] std::string FormatGeoJson(const std::vector<PoseRow>& rows);
// GPX 1.1: one track, a new segment after every gap; times in UTC.
[[nodiscard]] std::string FormatGpx(const std::vector<PoseRow>& rows);

}  // namespace panofix
