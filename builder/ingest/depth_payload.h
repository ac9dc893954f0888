#pragma once
// The bytes inside a .gsv file: base64 text to the payload, and the payload's fields.

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "builder/ingest/depth_map.h"
#include "common/base/status.h"

namespace panofix {

// Limits of what is read; Street View itself writes 512 x 256 with up to 256 planes.
inline constexpr int kMaxDepthPlanes = 256;
inline constexpr int kMaxDepthWidth = 4096;

struct DepthPayload {
  int width = 0, height = 0;
  bool is_zlib = false;
  std::vector<DepthPlane> planes;       // plane 0 zeroed
  std::vector<std::uint8_t> plane_idx;  // width * height, each < planes.size()
};

// Base64 of either alphabet, padding optional, white space at the end tolerated; another character
// is kBadData with its position.
[[nodiscard]] Result<std::vector<std::uint8_t>> DecodeBase64(std::string_view text);

// Raw or zlib payload to its fields, every one checked. kBadData, or kTooLarge.
[[nodiscard]] Result<DepthPayload> ParseDepthPayload(std::span<const std::uint8_t> bytes);

}  // namespace panofix
