#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include "builder/similarity/similarity_index.h"
#include "common/base/rng.h"

namespace panofix {
namespace {

using Lists = std::vector<std::vector<std::uint32_t>>;
using Positions = std::vector<std::array<double, 3>>;

constexpr int kViews = 8;

// Panoramas in a row, each linked to the next.
Lists Chain(std::uint32_t count) {
  Lists links(count);
  for (std::uint32_t i = 0; i + 1 < count; ++i)
    links[i].push_back(i + 1), links[i + 1].push_back(i);
  return links;
}

Positions Row(std::uint32_t count, double step_m) {
  Positions positions;
  for (std::uint32_t i = 0; i < count; ++i) positions.push_back({i * step_m, 0, 0});
  return positions;
}

SimilarityOptions Options(int dist_max, double dist_max_m = 80) {
  return {32, dist_max, dist_max_m};
}

TEST(AppearanceNeighbourhoods, IndexStepsAreHopsTimesViews) {
  // 48 steps of 8 views a panorama: 6 hops each way (the paper's 6 to 8 panoramas).
  const Lists found = AppearanceNeighbourhoods(Chain(30), Row(30, 11), kViews, Options(48));
  ASSERT_EQ(found.size(), 30U);
  EXPECT_EQ(found[15].front(), 9U);
  EXPECT_EQ(found[15].back(), 21U);
  EXPECT_EQ(found[15].size(), 13U);
  EXPECT_EQ(found[0], (std::vector<std::uint32_t>{0, 1, 2, 3, 4, 5, 6}));
}

TEST(AppearanceNeighbourhoods, LinksAreFollowedWhateverTheDistance) {
  // The road bends back: 0 and 3 touch on the ground and are three hops apart.
  const Positions positions{{0, 0, 0}, {50, 0, 0}, {50, 9, 0}, {0, 9, 0}};
  const Lists found = AppearanceNeighbourhoods(Chain(4), positions, kViews, Options(16));
  EXPECT_EQ(found[0], (std::vector<std::uint32_t>{0, 1, 2}));
  EXPECT_EQ(found[3], (std::vector<std::uint32_t>{1, 2, 3}));
}

TEST(AppearanceNeighbourhoods, HopsAreThoseOfTheShortestWay) {
  // A random graph against Floyd and Warshall.
  Rng rng(1, "tests/graph");
  constexpr std::uint32_t kCount = 40;
  Lists links = Chain(kCount);
  std::vector<std::vector<int>> hops(kCount, std::vector<int>(kCount, 1000));
  for (int extra = 0; extra < 12; ++extra) {
    const auto a = static_cast<std::uint32_t>(rng.Below(kCount)),
               b = static_cast<std::uint32_t>(rng.Below(kCount));
    links[a].push_back(b), links[b].push_back(a);
  }
  for (std::uint32_t i = 0; i < kCount; ++i) {
    hops[i][i] = 0;
    for (const std::uint32_t j : links[i]) hops[i][j] = std::min(hops[i][j], 1);
  }
  for (std::uint32_t k = 0; k < kCount; ++k) {
    for (std::uint32_t i = 0; i < kCount; ++i) {
      for (std::uint32_t j = 0; j < kCount; ++j)
        hops[i][j] = std::min(hops[i][j], hops[i][k] + hops[k][j]);
    }
  }
  const Lists found = AppearanceNeighbourhoods(links, Row(kCount, 11), kViews, Options(24));
  for (std::uint32_t i = 0; i < kCount; ++i) {
    std::vector<std::uint32_t> expected;
    for (std::uint32_t j = 0; j < kCount; ++j) {
      if (hops[i][j] <= 3) expected.push_back(j);
    }
    EXPECT_EQ(found[i], expected) << i;
  }
}

TEST(AppearanceNeighbourhoods, WithoutLinksMetresDecide) {
  Rng rng(1, "tests/metres");
  Positions positions;
  for (int i = 0; i < 300; ++i) {
    positions.push_back({rng.Uniform(-300, 300), rng.Uniform(-300, 300), rng.Uniform(0, 5)});
  }
  const Lists found = AppearanceNeighbourhoods(Lists(300), positions, kViews, Options(48, 55));
  for (std::uint32_t i = 0; i < 300; ++i) {
    std::vector<std::uint32_t> expected;
    for (std::uint32_t j = 0; j < 300; ++j) {
      if (std::hypot(positions[i][0] - positions[j][0], positions[i][1] - positions[j][1]) <= 55) {
        expected.push_back(j);
      }
    }
    EXPECT_EQ(found[i], expected) << i;
  }
}

TEST(AppearanceNeighbourhoods, ALonePanoramaHasItself) {
  EXPECT_EQ(AppearanceNeighbourhoods(Lists(1), Row(1, 1), kViews, Options(48)), (Lists{{0}}));
  EXPECT_TRUE(AppearanceNeighbourhoods({}, {}, kViews, Options(48)).empty());
  // A radius below one panorama still reaches the next.
  EXPECT_EQ(AppearanceNeighbourhoods(Chain(3), Row(3, 1), kViews, Options(1))[0],
            (std::vector<std::uint32_t>{0, 1}));
}

TEST(SimilarityOptions, CheckRefusesWhatMakesNoSense) {
  EXPECT_NO_THROW(SimilarityOptions().Check());
  EXPECT_THROW((SimilarityOptions{0, 48, 80}.Check()), std::invalid_argument);
  EXPECT_THROW((SimilarityOptions{32, 0, 80}.Check()), std::invalid_argument);
  EXPECT_THROW((SimilarityOptions{32, 48, 0}.Check()), std::invalid_argument);
  EXPECT_THROW((SimilarityOptions{32, 48, std::nan("")}.Check()), std::invalid_argument);
}

}  // namespace
}  // namespace panofix
