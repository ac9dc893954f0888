#include "builder/tiling/quadkey.h"

#include <gtest/gtest.h>

#include <cmath>

#include "common/base/rng.h"
#include "common/geometry/attitude.h"

namespace panofix {
namespace {

// A point inside Web Mercator tile (x, y) of a level: `u`, `v` in [0, 1) from its west and north.
Geodetic InTile(int x, int y, int level, double u = 0.5, double v = 0.5) {
  const double tiles = std::ldexp(1.0, level);
  const double mercator = M_PI * (1 - 2 * (y + v) / tiles);
  return {std::atan(std::sinh(mercator)) / kRadPerDeg, (x + u) / tiles * 360 - 180, 0};
}

// The published definition: bits of y and x interleaved, read in base 4.
std::string Interleaved(int x, int y, int level) {
  std::string key;
  for (int bit = level; bit-- > 0;)
    key += static_cast<char>('0' + 2 * (y >> bit & 1) + (x >> bit & 1));
  return key;
}

TEST(Quadkey, PublishedExample) { EXPECT_EQ(Quadkey(InTile(3, 5, 3), 3), "213"); }

TEST(Quadkey, AgreesWithTheDefinitionAllOverTheWorld) {
  Rng rng(1, "tests/quadkey");
  for (const int level : {1, 5, kTileLevel, 23}) {
    for (int i = 0; i < 500; ++i) {
      const auto tiles = std::uint64_t{1} << level;
      const int x = static_cast<int>(rng.Below(tiles)), y = static_cast<int>(rng.Below(tiles));
      const Geodetic point = InTile(x, y, level, rng.Uniform(0.01, 0.99), rng.Uniform(0.01, 0.99));
      EXPECT_EQ(Quadkey(point, level), Interleaved(x, y, level));
    }
  }
}

TEST(Quadkey, AChildStartsWithItsParent) {
  const Geodetic paris{48.85, 2.335, 0};
  for (int level = 2; level <= 20; ++level) {
    EXPECT_EQ(Quadkey(paris, level).substr(0, static_cast<std::size_t>(level - 1)),
              Quadkey(paris, level - 1));
  }
}

TEST(Quadkey, ATileIsAboutTwoHundredMetres) {
  const Geodetic paris{48.85, 2.335, 0};
  EXPECT_EQ(Quadkey(paris).size(), static_cast<std::size_t>(kTileLevel));
  EXPECT_NEAR(40075017 * std::cos(paris.lat_deg * kRadPerDeg) / (1 << kTileLevel), 200, 10);
}

TEST(Quadkey, PolesAndTheDateLineStayInTheOutermostTiles) {
  EXPECT_EQ(Quadkey({90, -180, 0}, 3), "000");
  EXPECT_EQ(Quadkey({90, 180, 0}, 3), "111");
  EXPECT_EQ(Quadkey({-90, -180, 0}, 3), "222");
  EXPECT_EQ(Quadkey({-90, 180, 0}, 3), "333");
}

}  // namespace
}  // namespace panofix
