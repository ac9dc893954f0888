#include <gtest/gtest.h>

#include "common/base/rng.h"
#include "runtime/pose/candidate.h"

namespace panofix {
namespace {

using Points = std::vector<Eigen::Vector2d>;

Camera SomeCamera() { return Camera::FromHorizontalFov(640, 480, 70); }

TEST(ImageSpread, UniformIsOne) {
  Points points;
  for (int y = 0; y < 480; y += 4) {
    for (int x = 0; x < 640; x += 4) points.emplace_back(x, y);
  }
  EXPECT_NEAR(ImageSpread(points, SomeCamera()), 1, 0.01);
}

TEST(ImageSpread, ClustersAndLinesAreNearZero) {
  Rng rng(1, "tests/spread");
  Points cluster, line;
  for (int i = 0; i < 300; ++i) {
    cluster.emplace_back(500 + rng.Uniform(0, 20), 100 + rng.Uniform(0, 20));
    line.emplace_back(2 * i, 100 + i);
  }
  EXPECT_LT(ImageSpread(cluster, SomeCamera()), 0.002);
  EXPECT_LT(ImageSpread(line, SomeCamera()), 1e-6);
}

TEST(ImageSpread, FallsWithTheArea) {
  Points whole, half;
  for (int y = 0; y < 480; y += 4) {
    for (int x = 0; x < 640; x += 4) {
      whole.emplace_back(x, y);
      half.emplace_back(0.5 * x, 0.5 * y);
    }
  }
  EXPECT_NEAR(ImageSpread(half, SomeCamera()) / ImageSpread(whole, SomeCamera()), 0.25, 1e-9);
}

TEST(ImageSpread, TooFewPointsHaveNone) {
  EXPECT_EQ(ImageSpread({}, SomeCamera()), 0.0);
  EXPECT_EQ(ImageSpread({{1, 2}, {300, 400}}, SomeCamera()), 0.0);
}

}  // namespace
}  // namespace panofix
