#include "runtime/pose/keypoint_grid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "common/base/rng.h"
#include "common/geometry/attitude.h"

namespace panofix {
namespace {

// 500 keypoints, some of them on and beyond the border.
class KeypointGridTest : public ::testing::Test {
 protected:
  KeypointGridTest() {
    camera_.width_px = 640, camera_.height_px = 480;
    for (int i = 0; i < 500; ++i) {
      features_.keypoints.push_back({static_cast<float>(rng_.Uniform(-20, camera_.width_px + 20)),
                                     static_cast<float>(rng_.Uniform(-20, camera_.height_px + 20)),
                                     static_cast<float>(rng_.Uniform(2, 60)),
                                     static_cast<float>(rng_.Uniform(0, 360)), 1});
    }
  }
  Eigen::Vector2d AnyPixel() {
    return {rng_.Uniform(-30, camera_.width_px + 30), rng_.Uniform(-30, camera_.height_px + 30)};
  }
  void ExpectThoseOf(const Eigen::Vector2d& px, double radius_px, const KeypointShape& shape) {
    std::vector<int> found{-7}, expected;  // what was found before goes
    KeypointGrid(features_, camera_).Within(px, radius_px, shape, &found);
    std::sort(found.begin(), found.end());
    for (std::size_t k = 0; k < features_.size(); ++k) {
      const Keypoint& keypoint = features_.keypoints[k];
      const double size_px{keypoint.size_px};
      if (std::hypot(double{keypoint.x_px} - px.x(), double{keypoint.y_px} - px.y()) <= radius_px &&
          size_px >= shape.min_size_px && size_px <= shape.max_size_px &&
          std::abs(AngleDifferenceDeg(double{keypoint.angle_deg}, shape.angle_deg)) <=
              shape.max_turn_deg) {
        expected.push_back(static_cast<int>(k));
      }
    }
    EXPECT_EQ(found, expected);
  }

  Rng rng_{1, "tests/grid"};
  Camera camera_;
  FeatureSet features_;
};

TEST_F(KeypointGridTest, IsARangeQuery) {
  for (int i = 0; i < 300; ++i) ExpectThoseOf(AnyPixel(), rng_.Uniform(0, 60), {});
}

TEST_F(KeypointGridTest, LeavesOutOtherSizesAndTurns) {
  for (int i = 0; i < 300; ++i) {
    const double size_px = rng_.Uniform(2, 60);
    // Angles of any number of turns.
    ExpectThoseOf(AnyPixel(), rng_.Uniform(20, 200),
                  {size_px / 1.8, size_px * 1.8, rng_.Uniform(-800, 800), rng_.Uniform(0, 180)});
  }
}

TEST_F(KeypointGridTest, FindsNothingAtWhatIsNoPixel) {
  std::vector<int> found;
  const KeypointGrid grid(features_, camera_);
  const double nan = std::nan("");
  grid.Within({nan, 100}, 20, {}, &found);
  EXPECT_TRUE(found.empty());
  grid.Within({1e30, -1e30}, 20, {}, &found);
  EXPECT_TRUE(found.empty());
}

}  // namespace
}  // namespace panofix
