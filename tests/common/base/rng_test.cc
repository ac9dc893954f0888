#include "common/base/rng.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <set>
#include <vector>

namespace panofix {
namespace {

constexpr int kNumDraws = 200000;

TEST(Rng, SameSeedAndStreamGiveTheSameNumbers) {
  Rng a(7, "train/sift"), b(7, "train/sift");
  for (int i = 0; i < 1000; ++i) ASSERT_EQ(a(), b());
}

TEST(Rng, SeedAndStreamBothMatter) {
  std::set<std::uint64_t> first;
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    for (const char* stream : {"", "a", "b", "ab", "ba", "train/0", "train/1"}) {
      first.insert(Rng(seed, stream)());
    }
  }
  EXPECT_EQ(first.size(), 350U);
}

// The reference code of xoshiro256** on this state; a change of the generator changes every bundle.
TEST(Rng, FollowsTheReferenceGenerator) {
  const auto split_mix = [](std::uint64_t& state) {
    std::uint64_t z = (state += 0x9e3779b97f4a7c15ULL);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return z ^ (z >> 31);
  };
  const auto rotl = [](std::uint64_t x, int k) { return (x << k) | (x >> (64 - k)); };
  constexpr std::uint64_t kEmptyFnv1a = 0xcbf29ce484222325ULL;
  std::uint64_t mixed = 42 ^ (kEmptyFnv1a * 0x9e3779b97f4a7c15ULL);
  std::array<std::uint64_t, 4> s{};
  for (auto& word : s) word = split_mix(mixed);
  Rng rng(42, "");
  for (int i = 0; i < 100; ++i) {
    const std::uint64_t expected = rotl(s[1] * 5, 7) * 9;
    const std::uint64_t t = s[1] << 17;
    s[2] ^= s[0], s[3] ^= s[1], s[1] ^= s[2], s[0] ^= s[3], s[2] ^= t, s[3] = rotl(s[3], 45);
    ASSERT_EQ(rng(), expected) << i;
  }
}

TEST(Rng, BelowIsInRangeAndUniform) {
  constexpr std::uint64_t kBound = 7;
  std::array<int, kBound> counts{};
  Rng rng(1, "tests/below");
  for (int i = 0; i < kNumDraws; ++i) {
    const std::uint64_t x = rng.Below(kBound);
    ASSERT_LT(x, kBound);
    ++counts[x];
  }
  // Chi-square with 6 degrees of freedom: 22.5 is its 99.9 % point; the seed is fixed.
  double chi2 = 0;
  const double expected = double{kNumDraws} / kBound;
  for (const int count : counts) chi2 += (count - expected) * (count - expected) / expected;
  EXPECT_LT(chi2, 22.5);
}

TEST(Rng, BelowTakesTheExtremes) {
  Rng rng(1, "tests/extremes");
  for (int i = 0; i < 100; ++i) {
    EXPECT_EQ(rng.Below(1), 0U);
    EXPECT_LT(rng.Below(Rng::max()), Rng::max());
  }
}

TEST(Rng, UniformFillsItsInterval) {
  Rng rng(1, "tests/uniform");
  double sum = 0, lowest = 1, highest = 0;
  for (int i = 0; i < kNumDraws; ++i) {
    const double x = rng.Uniform();
    ASSERT_GE(x, 0.0);
    ASSERT_LT(x, 1.0);
    sum += x, lowest = std::min(lowest, x), highest = std::max(highest, x);
  }
  // The mean's standard deviation is 0.00065; four of them.
  EXPECT_NEAR(sum / kNumDraws, 0.5, 0.0026);
  EXPECT_LT(lowest, 1e-3);
  EXPECT_GT(highest, 1 - 1e-3);
  for (int i = 0; i < 1000; ++i) {
    const double x = rng.Uniform(-3, 5);
    ASSERT_GE(x, -3.0);
    ASSERT_LT(x, 5.0);
  }
}

TEST(Rng, NormalHasTheMomentsOfANormal) {
  Rng rng(1, "tests/normal");
  double sum = 0, sum_sq = 0, sum_4 = 0;
  for (int i = 0; i < kNumDraws; ++i) {
    const double x = rng.Normal();
    ASSERT_TRUE(std::isfinite(x));
    sum += x, sum_sq += x * x, sum_4 += x * x * x * x;
  }
  // Four standard deviations of each moment's estimate.
  EXPECT_NEAR(sum / kNumDraws, 0, 4 * std::sqrt(1.0 / kNumDraws));
  EXPECT_NEAR(sum_sq / kNumDraws, 1, 4 * std::sqrt(2.0 / kNumDraws));
  EXPECT_NEAR(sum_4 / kNumDraws, 3, 4 * std::sqrt(96.0 / kNumDraws));
}

}  // namespace
}  // namespace panofix
