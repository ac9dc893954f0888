#pragma once
// Fills the pixels of a view that show nothing.

#include <cstdint>
#include <span>

#include "common/image/gray_image.h"

namespace panofix {

// Replaces pixels whose label is 0 by what lies around, ever smoother the farther inside the hole
// (pull-push; Gortler et al., "The lumigraph", SIGGRAPH 1996, section 3.4), so that no strong edge
// arises there. `labels` has one entry a pixel. An image without any other pixel turns mid-grey.
void FillHoles(std::span<const std::uint16_t> labels, GrayImage& image);

}  // namespace panofix
