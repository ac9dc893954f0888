#pragma once
// Writes .gsv payloads for tests, independently of the reader.

#include <zlib.h>

#include <bit>
#include <cstdint>
#include <string>
#include <vector>

namespace panofix {

struct TestPlane {
  float nx = 0, ny = 0, nz = 0, d_m = 0;
};

inline void PutU16(std::vector<std::uint8_t>& bytes, int value) {
  bytes.push_back(static_cast<std::uint8_t>(value & 0xFF));
  bytes.push_back(static_cast<std::uint8_t>(value >> 8));
}

// `planes[0]` is the unused row.
inline std::vector<std::uint8_t> GsvPayload(int width, int height,
                                            const std::vector<TestPlane>& planes,
                                            const std::vector<std::uint8_t>& plane_idx) {
  std::vector<std::uint8_t> bytes = {8};
  PutU16(bytes, static_cast<int>(planes.size()));
  PutU16(bytes, width);
  PutU16(bytes, height);
  bytes.push_back(8);
  bytes.insert(bytes.end(), plane_idx.begin(), plane_idx.end());
  for (const TestPlane& plane : planes) {
    for (const float value : {plane.nx, plane.ny, plane.nz, plane.d_m}) {
      const auto bits = std::bit_cast<std::uint32_t>(value);
      PutU16(bytes, static_cast<int>(bits & 0xFFFF));
      PutU16(bytes, static_cast<int>(bits >> 16));
    }
  }
  return bytes;
}

inline std::vector<std::uint8_t> ZlibCompressed(const std::vector<std::uint8_t>& bytes) {
  uLongf size = compressBound(static_cast<uLong>(bytes.size()));
  std::vector<std::uint8_t> packed(size);
  compress(packed.data(), &size, bytes.data(), static_cast<uLong>(bytes.size()));
  packed.resize(size);
  return packed;
}

inline std::string Base64(const std::vector<std::uint8_t>& bytes, bool url_safe = true,
                          bool padded = false) {
  std::string alphabet = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  if (url_safe) alphabet.replace(62, 2, "-_");
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t left = bytes.size() - i;
    const std::uint32_t group = static_cast<std::uint32_t>(bytes[i]) << 16 |
                                (left > 1 ? static_cast<std::uint32_t>(bytes[i + 1]) << 8 : 0U) |
                                (left > 2 ? static_cast<std::uint32_t>(bytes[i + 2]) : 0U);
    for (std::size_t k = 0; k < 4; ++k) {
      if (k <= left) {
        text += alphabet[group >> (18 - 6 * k) & 63];
      } else if (padded) {
        text += '=';
      }
    }
  }
  return text;
}

}  // namespace panofix
