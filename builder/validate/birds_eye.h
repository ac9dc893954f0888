#pragma once
// A bird's-eye picture of a drive on its map, as SVG.

#include <string>
#include <vector>

#include "common/drive/drive.h"
#include "common/drive/poses_csv.h"
#include "common/map/map_bundle.h"

namespace panofix {

// Panoramas and links in grey, the truth as a line, fixes coloured by error, degraded ones dashed
// (green 0 to red 1 m and beyond, magenta for false fixes, blue without truth), a line from each to
// its truth, frames without a fix as hollow marks on the truth; north up, with a scale bar and a
// legend.
[[nodiscard]] std::string BirdsEyeSvg(const MapBundle& bundle, const Drive& drive,
                                      const std::vector<PoseRow>& poses);

}  // namespace panofix
