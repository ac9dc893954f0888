#pragma once
// What a JPEG or PNG says of itself, read without decoding: kind, size, and whether all of it is
// there.

#include <cstddef>
#include <cstdint>
#include <span>

#include "common/base/status.h"
#include "common/image/gray_image.h"

namespace panofix {

enum class ImageKind { kJpeg, kPng };

struct ImageHeader {
  ImageKind kind = ImageKind::kJpeg;
  ImageSize size;
  int bits_per_channel = 8;
  int num_channels = 0;  // of a palette image: 1
  bool is_palette = false;
};

// Reads as far as the size (JPEG start of frame, PNG IHDR). kBadData where the bytes are neither
// kind, are cut short before the size, or state a size of 0.
[[nodiscard]] Result<ImageHeader> ParseImageHeader(std::span<const std::uint8_t> bytes);

// Walks the whole image: JPEG markers through the entropy-coded scans to the end marker, PNG chunks
// with their checksums to IEND. Bytes after the end are tolerated; kBadData where the end is
// missing or a chunk is damaged. Costs one pass over the bytes.
[[nodiscard]] Status CheckImageComplete(std::span<const std::uint8_t> bytes,
                                        const ImageHeader& header);

}  // namespace panofix
