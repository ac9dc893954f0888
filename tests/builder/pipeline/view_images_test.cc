#include "builder/pipeline/view_images.h"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "common/base/status.h"
#include "tests/common/features/synthetic_image.h"
#include "tests/common/io/temp_folder.h"

namespace panofix {
namespace {

constexpr int kJpegLevels = 12;  // grey levels that JPEG of quality 95 may be off at a blob's edge

class EncodeViewImagesTest : public testing::Test {
 protected:
  EncodeViewImagesTest() : rectifier_(Camera::FromHorizontalFov(120, 90, 80), RingOfViews(3, 0)) {
    features_.equalization = Equalization::kGlobal;
    for (std::uint64_t p = 0; p < 3; ++p) {
      GrayImage image = BusyImage(480, 240, p);
      const cv::Mat mat(image.height_px, image.width_px, CV_8UC1, image.pixels.data());
      ExtractedPanorama panorama;
      panorama.record.image = folder_ / (std::to_string(p) + ".png");
      EXPECT_TRUE(cv::imwrite(panorama.record.image.string(), mat));
      panoramas_.push_back(panorama);
    }
  }
  TempFolder folder_;
  Rectifier rectifier_;
  FeatureOptions features_;
  std::vector<ExtractedPanorama> panoramas_;
};

TEST_F(EncodeViewImagesTest, AreTheViewsAsTheyWereDescribed) {
  const auto images = EncodeViewImages(panoramas_, rectifier_, features_);
  ASSERT_EQ(images.size(), 9U);
  for (std::size_t p = 0; p < 3; ++p) {
    const GrayImage panorama =
        ValueOrThrow(DecodePanorama(panoramas_[p].record.image, rectifier_.camera()));
    for (int v = 0; v < 3; ++v) {
      const GrayImage expected = Preprocess(rectifier_.Cut(panorama, v), features_);
      const GrayImage found = ValueOrThrow(DecodeGray(images[3 * p + static_cast<std::size_t>(v)]));
      ASSERT_EQ(found.pixels.size(), expected.pixels.size());
      int worst = 0;
      for (std::size_t i = 0; i < expected.pixels.size(); ++i)
        worst = std::max(worst, std::abs(found.pixels[i] - expected.pixels[i]));
      EXPECT_LE(worst, kJpegLevels);
    }
  }
  EXPECT_EQ(EncodeViewImages(panoramas_, rectifier_, features_), images);
}

TEST_F(EncodeViewImagesTest, APanoramaThatIsGoneIsSaid) {
  std::filesystem::remove(panoramas_[1].record.image);
  EXPECT_THROW((void)EncodeViewImages(panoramas_, rectifier_, features_), Error);
  EXPECT_TRUE(EncodeViewImages({}, rectifier_, features_).empty());
}

}  // namespace
}  // namespace panofix
