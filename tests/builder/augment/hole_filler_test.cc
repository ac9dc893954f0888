#include "builder/augment/hole_filler.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>

#include "common/base/rng.h"

namespace panofix {
namespace {

constexpr int kWidth = 61, kHeight = 43;  // odd: the pyramid's last cells are cut short

struct Case {
  GrayImage image{kWidth, kHeight, std::vector<std::uint8_t>(kWidth* kHeight, 0)};
  std::vector<std::uint16_t> labels = std::vector<std::uint16_t>(kWidth * kHeight, 0);
  void Set(int x, int y, int grey) {
    image.pixels[static_cast<std::size_t>(y * kWidth + x)] = static_cast<std::uint8_t>(grey);
    labels[static_cast<std::size_t>(y * kWidth + x)] = 3;
  }
};

TEST(FillHoles, KeepsTheKnownAndStaysWithinIt) {
  Rng rng(1, "holes");
  Case known;
  for (int i = 0; i < 200; ++i) {
    known.Set(static_cast<int>(rng.Below(kWidth)), static_cast<int>(rng.Below(kHeight)),
              40 + static_cast<int>(rng.Below(100)));
  }
  GrayImage filled = known.image;
  FillHoles(known.labels, filled);
  for (std::size_t i = 0; i < filled.pixels.size(); ++i) {
    if (known.labels[i] != 0) {
      EXPECT_EQ(filled.pixels[i], known.image.pixels[i]);
    }
    EXPECT_GE(filled.pixels[i], 40);
    EXPECT_LT(filled.pixels[i], 140);
  }
}

TEST(FillHoles, OneGreyFillsEverything) {
  Case known;
  known.Set(7, 40, 93);
  FillHoles(known.labels, known.image);
  EXPECT_EQ(std::count(known.image.pixels.begin(), known.image.pixels.end(), 93), kWidth * kHeight);
}

TEST(FillHoles, NoStrongEdgeInsideAHole) {
  // Black at the left border, white at the right one: 255 levels over 61 pixels.
  Case known;
  for (int y = 0; y < kHeight; ++y) known.Set(0, y, 0), known.Set(kWidth - 1, y, 255);
  FillHoles(known.labels, known.image);
  constexpr int kMaxStep = 64;  // a quarter: what the finest interpolation puts beside the border
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 1; x < kWidth; ++x) {
      const auto at = known.image.pixels.begin() + y * kWidth + x;
      EXPECT_LE(std::abs(int{*at} - int{*(at - 1)}), kMaxStep) << x;
    }
  }
}

TEST(FillHoles, NothingKnownIsMidGrey) {
  Case known;
  FillHoles(known.labels, known.image);
  EXPECT_EQ(known.image.pixels, std::vector<std::uint8_t>(kWidth * kHeight, 128));
}

}  // namespace
}  // namespace panofix
