#pragma once
// What the `depth` command prints of one depth file.

#include <span>
#include <string>

#include "builder/ingest/depth_map.h"
#include "common/base/status.h"

namespace panofix {

struct DepthPixel {
  int column = 0, row = 0;
};

// "COL,ROW", whole numbers inside the map; kInvalidArgument otherwise.
[[nodiscard]] Result<DepthPixel> ParseDepthPixel(const std::string& text, const DepthMap& map);

// For people: a few lines, one a pixel. `name` is the file as the user gave it. Pixels outside the
// map throw std::out_of_range.
[[nodiscard]] std::string DepthReportText(const DepthMap& map, const std::string& name,
                                          std::span<const DepthPixel> pixels);
// For programs: file, encoding (raw, zlib, png), width, height, planes, placeholder, surface_share,
// ground_plane, ground_d_m, ground_normal (null where there is no ground), pixels: [{col, row,
// range_m, plane, normal}] (range_m and normal null where there is no surface).
[[nodiscard]] std::string DepthReportJson(const DepthMap& map, const std::string& name,
                                          std::span<const DepthPixel> pixels);

}  // namespace panofix
