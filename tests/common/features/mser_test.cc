#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "common/features/features.h"
#include "tests/common/features/synthetic_image.h"

namespace panofix {
namespace {

// A filled ellipse of grey `level` on grey 60.
GrayImage EllipseImage(int side_px, double cx, double cy, double a_px, double b_px, int level) {
  GrayImage image{side_px, side_px,
                  std::vector<std::uint8_t>(static_cast<std::size_t>(side_px * side_px), 60)};
  for (int y = 0; y < side_px; ++y) {
    for (int x = 0; x < side_px; ++x) {
      if (std::pow((x - cx) / a_px, 2) + std::pow((y - cy) / b_px, 2) <= 1) {
        image.pixels[static_cast<std::size_t>(y * side_px + x)] = static_cast<std::uint8_t>(level);
      }
    }
  }
  return image;
}

// Second moments of an ellipse are a^2/4 and b^2/4: the size 4 (det S)^(1/4) is 2 sqrt(a b).
TEST(ExtractMser, AnEllipseHasItsCentreAndMeanDiameter) {
  for (const int level : {200, 5}) {
    const FeatureSet found = ExtractMser(EllipseImage(256, 120, 140, 24, 13, level), {});
    ASSERT_GE(found.size(), 1U);
    bool seen = false;
    for (const Keypoint& k : found.keypoints) {
      const double off_px = std::hypot(double{k.x_px} - 120, double{k.y_px} - 140);
      seen |= off_px < 0.1 && std::abs(double{k.size_px} - 2 * std::sqrt(24.0 * 13.0)) < 0.3;
      EXPECT_EQ(k.angle_deg, 0.0F);
    }
    EXPECT_TRUE(seen) << level;
  }
}

TEST(ExtractMser, LargestFirstAndNoMoreThanAsked) {
  FeatureOptions options;
  const GrayImage image = BusyImage(320, 240, 5);
  const FeatureSet all = ExtractMser(image, options);
  ASSERT_GT(all.size(), 12U);
  for (std::size_t i = 1; i < all.size(); ++i) {
    EXPECT_GE(all.keypoints[i - 1].response, all.keypoints[i].response);
  }
  options.max_mser = 10;
  const FeatureSet few = ExtractMser(image, options);
  ASSERT_EQ(few.size(), 10U);
  EXPECT_TRUE(std::equal(few.descriptors.begin(), few.descriptors.end(), all.descriptors.begin()));
}

TEST(ExtractMser, DoesNotDependOnThreads) {
  const GrayImage image = BusyImage(320, 240, 6);
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const FeatureSet serial = ExtractMser(image, {});
  cv::setNumThreads(threads);
  const FeatureSet parallel = ExtractMser(image, {});
  EXPECT_EQ(serial.descriptors, parallel.descriptors);
}

TEST(ExtractMser, NothingToFind) {
  FeatureOptions off;
  off.max_mser = 0;
  EXPECT_EQ(ExtractMser(BusyImage(320, 240, 7), off).size(), 0U);
  EXPECT_EQ(ExtractMser({}, {}).size(), 0U);
  EXPECT_EQ(ExtractMser(BlobImage(320, 240, {}), {}).size(), 0U);
  EXPECT_EQ(ExtractMser(BlobImage(16, 16, {}), {}).size(), 0U);
  // A line of one pixel has no area to describe.
  GrayImage line = BlobImage(320, 240, {});
  for (std::size_t x = 20; x < 300; ++x) line.pixels[120 * 320 + x] = 255;
  EXPECT_EQ(ExtractMser(line, {}).size(), 0U);
}

}  // namespace
}  // namespace panofix
