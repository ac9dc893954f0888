#include <gtest/gtest.h>

#include <limits>
#include <opencv2/core.hpp>

#include "common/features/features.h"
#include "tests/common/features/synthetic_image.h"

namespace panofix {
namespace {

// The centre of an isolated blob of 3 px, from 8-bit pixels: OpenCV's interpolation leaves less.
constexpr double kCentre_px = 0.06;

// Distance from the blob to the nearest keypoint, as found - true.
Eigen::Vector2d NearestOffset(const FeatureSet& found, const Blob& blob) {
  Eigen::Vector2d best(1e9, 1e9);
  for (const Keypoint& k : found.keypoints) {
    const Eigen::Vector2d offset(double{k.x_px} - blob.x_px, double{k.y_px} - blob.y_px);
    if (offset.norm() < best.norm()) best = offset;
  }
  return best;
}

void ExpectSameFeatures(const FeatureSet& a, const FeatureSet& b) {
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(a.descriptors, b.descriptors);
  for (std::size_t i = 0; i < a.size(); ++i) {
    const Keypoint &x = a.keypoints[i], &y = b.keypoints[i];
    EXPECT_TRUE(x.x_px == y.x_px && x.y_px == y.y_px && x.size_px == y.size_px &&
                x.angle_deg == y.angle_deg && x.response == y.response)
        << i;
  }
}

// Integer coordinates are pixel centres: without the quarter-pixel correction the mean is 0.25 off.
TEST(ExtractSift, FindsBlobsWhereTheyAre) {
  Rng rng(1, "tests/blobs");
  std::vector<Blob> blobs;
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column < 8; ++column) {
      blobs.push_back({60.0 + 75 * column + rng.Uniform(-0.5, 0.5),
                       50.0 + 75 * row + rng.Uniform(-0.5, 0.5), 3, row % 2 == 0 ? 100.0 : -100.0});
    }
  }
  const FeatureSet found = ExtractSift(BlobImage(660, 480, blobs), {});
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const Blob& blob : blobs) {
    const Eigen::Vector2d offset = NearestOffset(found, blob);
    EXPECT_LE(offset.norm(), kCentre_px) << blob.x_px << " " << blob.y_px;
    mean += offset / static_cast<double>(blobs.size());
  }
  EXPECT_LE(mean.norm(), 0.02);
}

// The same places from half the picture, where nothing small is found.
TEST(ExtractCoarseSift, FindsLargeBlobsWhereTheyAre) {
  Rng rng(2, "tests/blobs");
  std::vector<Blob> blobs;
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 6; ++column) {
      blobs.push_back({60.0 + 100 * column + rng.Uniform(-0.5, 0.5),
                       60.0 + 100 * row + rng.Uniform(-0.5, 0.5), 6,
                       row % 2 == 0 ? 100.0 : -100.0});
    }
  }
  const GrayImage image = BlobImage(661, 479, blobs);  // odd: halves are not exact
  const FeatureSet found = ExtractCoarseSift(image, {});
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const Blob& blob : blobs) {
    const Eigen::Vector2d offset = NearestOffset(found, blob);
    EXPECT_LE(offset.norm(), 2 * kCentre_px) << blob.x_px << " " << blob.y_px;
    mean += offset / static_cast<double>(blobs.size());
  }
  EXPECT_LE(mean.norm(), 0.06);
  for (const Keypoint& k : found.keypoints) EXPECT_GE(k.size_px, 0.85 * kSmallestCoarseRegion_px);
  // The size is the one that the full picture shows.
  EXPECT_NEAR(found.keypoints[0].size_px / ExtractSift(image, {}).keypoints[0].size_px, 1, 0.1);
  EXPECT_EQ(ExtractCoarseSift(GrayImage{1, 1, {0}}, {}).size(), 0U);
}

// An image and its mirror image show the same centres: a shift of either sign breaks this.
TEST(ExtractSift, MirroringMirrorsTheCentres) {
  const std::vector<Blob> blobs{
      {80.3, 70.6, 3, 100}, {180.8, 90.2, 5, -90}, {120.5, 160.4, 4, 110}};
  std::vector<Blob> mirrored = blobs;
  for (Blob& blob : mirrored) blob.x_px = 255 - blob.x_px, blob.y_px = 255 - blob.y_px;
  const FeatureSet a = ExtractSift(BlobImage(256, 256, blobs), {});
  const FeatureSet b = ExtractSift(BlobImage(256, 256, mirrored), {});
  for (std::size_t i = 0; i < blobs.size(); ++i) {
    EXPECT_LE((NearestOffset(a, blobs[i]) + NearestOffset(b, mirrored[i])).norm(), kCentre_px);
  }
}

TEST(ExtractSift, SizeFollowsTheBlob) {
  for (const double sigma_px : {2.0, 4.0, 8.0}) {
    const Blob blob{128, 128, sigma_px, 100};
    const FeatureSet found = ExtractSift(BlobImage(257, 257, {blob}), {});
    double size_px = 0;
    for (const Keypoint& k : found.keypoints) {
      const double off = std::hypot(double{k.x_px} - blob.x_px, double{k.y_px} - blob.y_px);
      if (off < 0.5) size_px = double{k.size_px};
    }
    // The scale-space extremum of a Gaussian blob lies at its own sigma; the size is a diameter.
    EXPECT_NEAR(size_px, 2 * sigma_px, 0.5 * sigma_px);
  }
}

TEST(ExtractSift, DoesNotDependOnThreadsOrRepetition) {
  const GrayImage image = BusyImage(320, 240, 1);
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const FeatureSet serial = ExtractSift(image, {});
  cv::setNumThreads(threads);
  const FeatureSet parallel = ExtractSift(image, {});
  const FeatureSet again = ExtractSift(image, {});
  EXPECT_GT(serial.size(), 100U);
  ExpectSameFeatures(serial, parallel);
  ExpectSameFeatures(parallel, again);
}

TEST(ExtractSift, StrongestFirstAndNoMoreThanAsked) {
  FeatureOptions options;
  const GrayImage image = BusyImage(320, 240, 2);
  const FeatureSet all = ExtractSift(image, options);
  options.max_sift = 60;
  const FeatureSet few = ExtractSift(image, options);
  ASSERT_GT(all.size(), 100U);
  EXPECT_EQ(few.size(), 60U);
  for (const FeatureSet* set : {&all, &few}) {
    for (std::size_t i = 1; i < set->size(); ++i) {
      EXPECT_GE(set->keypoints[i - 1].response, set->keypoints[i].response);
    }
  }
  EXPECT_EQ(few.keypoints[0].response, all.keypoints[0].response);
}

// Equal responses at the cut: OpenCV keeps them all, the limit holds nevertheless.
TEST(ExtractSift, TheLimitHoldsAmongEquals) {
  std::vector<Blob> blobs;
  for (int row = 0; row < 9; ++row) {
    for (int column = 0; column < 9; ++column)
      blobs.push_back({32.0 + 32 * column, 32.0 + 32 * row, 3, 100});
  }
  FeatureOptions options;
  options.max_sift = 50;
  EXPECT_LE(ExtractSift(BlobImage(320, 320, blobs), options).size(), 50U);
}

TEST(ExtractSift, RootSiftHasUnitLength) {
  const FeatureSet found = ExtractSift(BusyImage(320, 240, 3), {});
  ASSERT_GT(found.size(), 50U);
  ASSERT_EQ(found.descriptors.size(), found.size() * kDescriptorSize);
  for (std::size_t i = 0; i < found.size(); ++i) {
    double sum_sq = 0;
    bool saturated = false;
    for (const std::uint8_t byte : found.descriptor(i)) {
      sum_sq += std::pow(static_cast<double>(byte), 2);
      saturated |= byte == 255;
    }
    // Rounding 128 entries moves the length by at most half the root of 128.
    if (saturated) continue;
    EXPECT_NEAR(std::sqrt(sum_sq), 512, 5.7);
  }
}

TEST(ExtractSift, RootSiftIsTheRootOfSift) {
  FeatureOptions plain_options;
  plain_options.root_sift = false;
  const GrayImage image = BusyImage(320, 240, 4);
  const FeatureSet plain = ExtractSift(image, plain_options), root = ExtractSift(image, {});
  ASSERT_EQ(plain.size(), root.size());
  for (std::size_t i = 0; i < plain.size(); ++i) {
    double sum = 0;
    for (const std::uint8_t byte : plain.descriptor(i)) sum += static_cast<double>(byte);
    for (std::size_t d = 0; d < kDescriptorSize; ++d) {
      const double share = static_cast<double>(plain.descriptor(i)[d]) / sum;
      EXPECT_NEAR(static_cast<double>(root.descriptor(i)[d]),
                  std::min(255.0, 512 * std::sqrt(share)), 1.0);
    }
  }
}

TEST(ExtractSift, NothingToFind) {
  EXPECT_EQ(ExtractSift({}, {}).size(), 0U);
  EXPECT_EQ(ExtractSift(BlobImage(320, 240, {}), {}).size(), 0U);
  EXPECT_EQ(ExtractSift(BlobImage(1, 1, {}), {}).size(), 0U);
  EXPECT_EQ(ExtractSift(BlobImage(16, 3, {}), {}).size(), 0U);
}

}  // namespace
}  // namespace panofix
