#include "common/map/landmark_codes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "common/base/rng.h"

namespace panofix {
namespace {

using Descriptor = std::array<std::uint8_t, kDescriptorSize>;

// Decoded lengths are powers in doubles; logarithms of them round.
constexpr double kRounding = 1e-9;

double LongestCoded_m() { return kShortestCoded_m * std::pow(kLengthCodeRatio, 255); }

TEST(LengthCode, EveryCodeIsItsOwnRoundTrip) {
  for (int code = 0; code < 256; ++code) {
    const double length_m = DecodeLength(static_cast<std::uint8_t>(code));
    EXPECT_NEAR(length_m / (kShortestCoded_m * std::pow(kLengthCodeRatio, code)), 1, kRounding);
    EXPECT_EQ(EncodeLength(length_m), code);
  }
}

TEST(LengthCode, IsWithinHalfAStep) {
  Rng rng(1, "tests/lengths");
  const double half_step = std::sqrt(kLengthCodeRatio) * (1 + kRounding);
  for (int i = 0; i < 5000; ++i) {
    const double length_m =
        kShortestCoded_m * std::exp(rng.Uniform(0, 255) * std::log(kLengthCodeRatio));
    const double ratio = DecodeLength(EncodeLength(length_m)) / length_m;
    EXPECT_LE(ratio, half_step) << length_m;
    EXPECT_GE(ratio, 1 / half_step) << length_m;
  }
}

TEST(LengthCode, EndsAreKept) {
  EXPECT_GT(LongestCoded_m(), 21);
  EXPECT_LT(LongestCoded_m(), 23);
  for (const double small_m : {kShortestCoded_m, 1e-9, 0.0, -1.0})
    EXPECT_EQ(EncodeLength(small_m), 0) << small_m;
  for (const double large_m : {LongestCoded_m(), 25.0, 1e6, 1e300})
    EXPECT_EQ(EncodeLength(large_m), 255) << large_m;
}

// A sigma that is no number must not become the best of all.
TEST(LengthCode, WhatIsNoLengthIsTheLongest) {
  EXPECT_EQ(EncodeLength(std::numeric_limits<double>::infinity()), 255);
  EXPECT_EQ(EncodeLength(std::numeric_limits<double>::quiet_NaN()), 255);
}

TEST(AngleCode, EveryCodeIsItsOwnRoundTripWhateverTheTurn) {
  for (int code = 0; code < 256; ++code) {
    const double angle_deg = DecodeAngle(static_cast<std::uint8_t>(code));
    EXPECT_EQ(angle_deg, code * 360.0 / 256);
    for (const double turns : {-2.0, -1.0, 0.0, 1.0, 2.0})
      EXPECT_EQ(EncodeAngle(angle_deg + 360 * turns), code) << turns;
  }
}

TEST(AngleCode, IsWithinHalfAStep) {
  Rng rng(1, "tests/angles");
  for (int i = 0; i < 5000; ++i) {
    const double angle_deg = rng.Uniform(-720, 720);
    const double off_deg = std::remainder(DecodeAngle(EncodeAngle(angle_deg)) - angle_deg, 360);
    EXPECT_LE(std::abs(off_deg), 0.5 * 360 / 256 + kRounding) << angle_deg;
  }
  // Just below a full turn is nearer to none.
  EXPECT_EQ(EncodeAngle(359.9), 0);
}

Descriptor RoundTrip(const Descriptor& descriptor) {
  std::array<std::uint8_t, kPackedDescriptorSize> packed;
  Descriptor back;
  PackDescriptor(descriptor, packed.data());
  UnpackDescriptor(packed.data(), back.data());
  return back;
}

TEST(PackedDescriptor, EachEntryKeepsItsPlaceAndItsNearestStep) {
  for (int value = 0; value < 256; ++value) {
    for (const std::size_t at : {0, 1, 64, 127}) {
      Descriptor descriptor{};
      descriptor[at] = static_cast<std::uint8_t>(value);
      const Descriptor back = RoundTrip(descriptor);
      for (std::size_t i = 0; i < kDescriptorSize; ++i) {
        if (i == at) continue;
        EXPECT_EQ(back[i], 0) << at << " " << i;
      }
      EXPECT_EQ(back[at] % kDescriptorStep, 0);
      EXPECT_LE(std::abs(back[at] - std::min(value, 150)), kDescriptorStep / 2) << value;
    }
  }
}

TEST(PackedDescriptor, TheLowHalfComesFirst) {
  Descriptor descriptor{};
  descriptor[0] = 30, descriptor[1] = 120;
  std::array<std::uint8_t, kPackedDescriptorSize> packed;
  PackDescriptor(descriptor, packed.data());
  EXPECT_EQ(packed[0], 3 | (12 << 4));
  EXPECT_EQ(packed[1], 0);
}

TEST(PackedDescriptor, EveryByteIsTwoEntries) {
  for (int byte = 0; byte < 256; ++byte) {
    std::array<std::uint8_t, kPackedDescriptorSize> packed{};
    const auto at = static_cast<std::size_t>(byte) % packed.size();
    packed[at] = static_cast<std::uint8_t>(byte);
    Descriptor descriptor, expected{};
    UnpackDescriptor(packed.data(), descriptor.data());
    expected[2 * at] = static_cast<std::uint8_t>(byte % 16 * kDescriptorStep);
    expected[2 * at + 1] = static_cast<std::uint8_t>(byte / 16 * kDescriptorStep);
    EXPECT_EQ(descriptor, expected) << byte;
  }
}

// Entries below 155 move by half a step at most: 128 of them by 57 in all, and by 33 as a rule.
TEST(PackedDescriptor, DistancesMoveByNoMoreThanTheRounding) {
  const double bound = std::sqrt(double{kDescriptorSize}) * kDescriptorStep / 2;
  Rng rng(1, "tests/packed");
  double sum_sq = 0;
  constexpr int kTrials = 500;
  for (int trial = 0; trial < kTrials; ++trial) {
    Descriptor descriptor;
    for (auto& entry : descriptor) entry = static_cast<std::uint8_t>(rng.Below(155));
    const Descriptor back = RoundTrip(descriptor);
    double distance_sq = 0;
    for (std::size_t i = 0; i < kDescriptorSize; ++i)
      distance_sq += std::pow(descriptor[i] - back[i], 2);
    EXPECT_LE(std::sqrt(distance_sq), bound);
    sum_sq += distance_sq / kTrials;
  }
  // Whole numbers uniform over a step: variance (step^2 + 2) / 12 where halves round up.
  const double expected = kDescriptorSize * (kDescriptorStep * kDescriptorStep + 2) / 12.0;
  EXPECT_NEAR(sum_sq / expected, 1, 0.05);
}

TEST(PackedDescriptor, WhatIsPackedStaysWhenPackedAgain) {
  Rng rng(1, "tests/packed_again");
  for (int trial = 0; trial < 50; ++trial) {
    Descriptor descriptor;
    for (auto& entry : descriptor) entry = static_cast<std::uint8_t>(rng.Below(256));
    const Descriptor once = RoundTrip(descriptor);
    EXPECT_EQ(RoundTrip(once), once);
  }
}

}  // namespace
}  // namespace panofix
