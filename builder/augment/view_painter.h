#pragma once
// Draws a view: labels its pixels and samples the panoramas.

#include <vector>

#include "builder/augment/surface_caster.h"

namespace panofix {

// Returns the view, black where it shows nothing; `labels` (one a pixel, row-major, zero) receives
// what each pixel shows. Labels are cast on a coarse grid that is refined where they differ, down
// to two pixels. Within a block of one label, panorama coordinates are interpolated between the
// block's corners, to at most 0.1 px of error; a block that bends more is split.
[[nodiscard]] GrayImage PaintView(SurfaceCaster& caster, const Camera& camera,
                                  std::vector<SurfaceLabel>& labels);

}  // namespace panofix
