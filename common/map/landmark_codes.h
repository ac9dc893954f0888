#pragma once
// How a landmark's numbers are stored in few bytes.

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

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
#if defined(__SSE2__)
  static_assert(kDescriptorStep == 10);
  const auto times_ten = [](__m128i code) {
    const __m128i two = _mm_add_epi8(code, code), four = _mm_add_epi8(two, two);
    return _mm_add_epi8(_mm_add_epi8(four, four), two);
  };
  const __m128i four_bits = _mm_set1_epi8(15);
  for (std::size_t i = 0; i < kPackedDescriptorSize; i += 16) {
    const __m128i codes = _mm_loadu_si128(reinterpret_cast<const __m128i*>(packed + i));
    const __m128i even = times_ten(_mm_and_si128(codes, four_bits));
    const __m128i odd = times_ten(_mm_and_si128(_mm_srli_epi16(codes, 4), four_bits));
    auto* out = reinterpret_cast<__m128i*>(descriptor + 2 * i);
    _mm_storeu_si128(out, _mm_unpacklo_epi8(even, odd));
    _mm_storeu_si128(out + 1, _mm_unpackhi_epi8(even, odd));
  }
#else
  for (std::size_t i = 0; i < kPackedDescriptorSize; ++i) {
    descriptor[2 * i] = static_cast<std::uint8_t>((packed[i] & 15) * kDescriptorStep);
    descriptor[2 * i + 1] = static_cast<std::uint8_t>((packed[i] >> 4) * kDescriptorStep);
  }
#endif
}

}  // namespace panofix
