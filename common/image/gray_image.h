#pragma once
// An 8-bit grey image and the bounded decoders that make one from outside bytes.

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "common/base/status.h"
#include "common/io/read_file.h"

namespace panofix {

// Row-major, no padding: pixel (x, y) is pixels[y * width_px + x].
struct GrayImage {
  int width_px = 0, height_px = 0;
  std::vector<std::uint8_t> pixels;
  [[nodiscard]] bool empty() const { return pixels.empty(); }
};

struct ImageSize {
  int width_px = 0, height_px = 0;
};

struct DecodeLimits {
  std::size_t max_bytes = std::size_t{256} << 20;  // of the encoded file
  std::int64_t max_pixels = 400'000'000;  // of the full-size image; checked before decoding
};

// Size from the header of a JPEG or PNG, without decoding. kBadData where it is neither, or cut
// short.
[[nodiscard]] Result<ImageSize> ReadImageSize(std::span<const std::uint8_t> bytes);

// Decodes JPEG or PNG to grey. `reduction` 1, 2, 4 or 8 divides each side while decoding (a JPEG's
// DCT scaling); pixel (c, r) of the result then covers its reduction x reduction block of the
// original, a last block that is cut short counting whole. Orientation tags are not applied. A
// decoder that stops early (truncated file) is kBadData, never a half-grey image.
[[nodiscard]] Result<GrayImage> DecodeGray(std::span<const std::uint8_t> bytes, int reduction = 1,
                                           const DecodeLimits& limits = {});

// A 16-bit single-channel raster, row-major as GrayImage.
struct Gray16Image {
  int width_px = 0, height_px = 0;
  std::vector<std::uint16_t> pixels;
};

// Decodes a PNG of one 16-bit channel; kBadData names what any other image holds.
[[nodiscard]] Result<Gray16Image> DecodePng16(std::span<const std::uint8_t> bytes,
                                              const DecodeLimits& limits = {});

}  // namespace panofix
