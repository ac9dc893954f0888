#pragma once
// JPEG to grey through libjpeg itself: OpenCV's door to it cannot tell a picture that ends early,
// which libjpeg fills with grey, from a whole one, and lets it write to standard error.

#include <cstdint>
#include <span>

#include "common/base/status.h"
#include "common/image/gray_image.h"

namespace panofix {

// `size` is what the header states; the result's sides are divided by `reduction` (1, 2, 4, 8),
// rounded up. kBadData where libjpeg gives up, or only goes on by inventing picture data.
[[nodiscard]] Result<GrayImage> DecodeJpegGray(std::span<const std::uint8_t> bytes, ImageSize size,
                                               int reduction);

}  // namespace panofix
