#pragma once
// How a landmark's numbers are stored in few bytes.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>

#include "common/features/features.h"

namespace panofix {

// Lengths from 1 mm to 22 m in steps of 4 %; what is not finite is the longest.
inline constexpr double kShortestCoded_m = 1e-3, kLengthCodeRatio = 1.04;
[[nodiscard]] inline std::uint8_t EncodeLength(double length_m) {
  if (!std::isfinite(length_m)) return 255;
  const double step = std::log(std::max(length_m, kShortestCoded_m) / kShortestCoded_m) /
                      std::log(kLengthCodeRatio);
  return static_cast<std::uint8_t>(std::clamp(std::lround(step), 0L, 255L));
}
[[nodiscard]] inline double DecodeLength(std::uint8_t code) {
  static const std::array<double, 256> kLengths_m = [] {
    std::array<double, 256> lengths_m{};
    for (int i = 0; i < 256; ++i)
      lengths_m[static_cast<std::size_t>(i)] = kShortestCoded_m * std::pow(kLengthCodeRatio, i);
    return lengths_m;
  }();
  return kLengths_m[code];
}

// Angles in steps of 1.4 degrees.
[[nodiscard]] inline std::uint8_t EncodeAngle(double angle_deg) {
  return static_cast<std::uint8_t>(std::lround(angle_deg * 256 / 360) & 255);
}
[[nodiscard]] inline double DecodeAngle(std::uint8_t code) { return code * 360.0 / 256; }

// Descriptors at four bits an entry, two a byte, low half first. RootSIFT entries rarely exceed
// 150; the rounding adds 29 to distances of some 250 between true matches, in quadrature.
inline constexpr int kPackedDescriptorSize = kDescriptorSize / 2;
inline constexpr int kDescriptorStep = 10;
inline void PackDescriptor(std::span<const std::uint8_t, kDescriptorSize> descriptor,
                           std::uint8_t* packed) {
  const auto code = [&](std::size_t i) {
    return static_cast<std::uint8_t>(
        std::min(15, (descriptor[i] + kDescriptorStep / 2) / kDescriptorStep));
  };
  for (std::size_t i = 0; i < kPackedDescriptorSize; ++i) {
    packed[i] = static_cast<std::uint8_t>(code(2 * i) | (code(2 * i + 1) << 4));
  }
}
inline void UnpackDescriptor(const std::uint8_t* packed, std::uint8_t* descriptor) {
  for (std::size_t i = 0; i < kPackedDescriptorSize; ++i) {
    descriptor[2 * i] = static_cast<std::uint8_t>((packed[i] & 15) * kDescriptorStep);
    descriptor[2 * i + 1] = static_cast<std::uint8_t>((packed[i] >> 4) * kDescriptorStep);
  }
}

}  // namespace panofix
