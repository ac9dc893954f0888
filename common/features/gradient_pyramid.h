#pragma once
// What a GradientPyramid holds; private to kVLD.

#include <cstdint>
#include <vector>

#include "common/features/kvld.h"

namespace panofix {

inline constexpr double kGradientNormUnit = 1.0 / 128;  // grey levels of one count

// Central differences of one pixel in one word: low half the gradient's turn in 1/65536 of a
// circle, clockwise from x as angles are in an image; high half its norm in kGradientNormUnit.
using GradientPixel = std::uint32_t;
inline int GradientTurn(GradientPixel pixel) { return static_cast<int>(pixel & 0xffff); }
inline int GradientNorm(GradientPixel pixel) { return static_cast<int>(pixel >> 16); }

// A pixel covers ratio x ratio pixels of the image, whose pixel x has its centre at
// (x + 0.5) / ratio - 0.5. Row-major; border pixels have norm 0.
struct GradientLevel {
  double ratio = 1;
  int width_px = 0, height_px = 0;
  std::vector<GradientPixel> pixels;
};

struct GradientPyramid::Impl {
  int width_px = 0, height_px = 0;
  std::vector<GradientLevel> levels;  // ratio sqrt(2)^i
};

}  // namespace panofix
