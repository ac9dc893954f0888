#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "builder/rectify/rectifier.h"

namespace panofix {
namespace {

class PanoramaImage : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::path(testing::TempDir()) / "panofix_panorama_image";
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  [[nodiscard]] std::filesystem::path Write(const char* name, const cv::Mat& mat) const {
    cv::imwrite((folder_ / name).string(), mat);
    return folder_ / name;
  }
  std::filesystem::path folder_;
};

// Matches a panorama of `width_px` columns at its centre.
Camera CameraMatching(double width_px) {
  Camera camera = Camera::FromHorizontalFov(64, 48, 60);
  camera.fx_px = camera.fy_px = width_px / (2 * std::numbers::pi);
  return camera;
}

TEST(PanoramaReduction, StaysAtLeastAsFineAsTheViews) {
  const Camera camera = CameraMatching(1000);
  EXPECT_EQ(PanoramaReduction(500, camera), 1);
  EXPECT_EQ(PanoramaReduction(1999, camera), 1);
  EXPECT_EQ(PanoramaReduction(2001, camera), 2);
  EXPECT_EQ(PanoramaReduction(4001, camera), 4);
  EXPECT_EQ(PanoramaReduction(7999, camera), 4);
  EXPECT_EQ(PanoramaReduction(8001, camera), 8);
  EXPECT_EQ(PanoramaReduction(100000, camera), 8);
}

TEST_F(PanoramaImage, ReducesOnlyByWholeBlocks) {
  const auto path = Write("a.png", cv::Mat(102, 204, CV_8UC1, cv::Scalar(9)));
  const auto image = DecodePanorama(path, CameraMatching(20));  // 8 by resolution; 102 allows 2
  ASSERT_TRUE(image.ok()) << image.status().message();
  EXPECT_EQ(image->width_px, 102);
  EXPECT_EQ(image->height_px, 51);
}

// Stripes of two columns cannot be shown by views 1.9 times coarser: the prefilter must fade them
// to a Gaussian's response at their frequency instead of letting them alias.
TEST_F(PanoramaImage, PrefilterFadesWhatViewsCannotShow) {
  constexpr int kWidth = 256;
  cv::Mat stripes(kWidth / 2, kWidth, CV_8UC1);
  for (int x = 0; x < kWidth; ++x) stripes.col(x).setTo(x % 2 == 0 ? 28 : 228);
  const auto path = Write("stripes.png", stripes);
  const double ratio = 1.9;
  const auto image = DecodePanorama(path, CameraMatching(kWidth / ratio));
  ASSERT_TRUE(image.ok());
  ASSERT_EQ(image->width_px, kWidth);
  const double sigma_px = 0.5 * std::sqrt(ratio * ratio - 1);
  // A Gaussian's gain at half a cycle a pixel, doubled for sampling; plus rounding.
  const double bound = 100 * 2 * std::exp(-0.5 * std::pow(std::numbers::pi * sigma_px, 2)) + 2;
  for (const std::uint8_t value : image->pixels) ASSERT_NEAR(value, 128, bound);
}

TEST_F(PanoramaImage, PrefilterJoinsTheSeam) {
  constexpr int kWidth = 256;
  cv::Mat spot(kWidth / 2, kWidth, CV_8UC1, cv::Scalar(0));
  spot.col(0).setTo(200);
  const auto path = Write("seam.png", spot);
  const auto image = DecodePanorama(path, CameraMatching(kWidth / 1.9));
  ASSERT_TRUE(image.ok());
  const std::uint8_t* row = image->pixels.data() + 64 * kWidth;
  EXPECT_GT(row[1], 0);
  EXPECT_EQ(row[1], row[kWidth - 1]);
}

TEST_F(PanoramaImage, WhereViewsAreFinerNothingIsChanged) {
  cv::Mat noise(64, 128, CV_8UC1);
  cv::theRNG().state = 7;
  cv::randu(noise, 0, 255);
  const auto image = DecodePanorama(Write("noise.png", noise), CameraMatching(200));
  ASSERT_TRUE(image.ok());
  EXPECT_TRUE(std::equal(image->pixels.begin(), image->pixels.end(), noise.begin<std::uint8_t>()));
}

TEST_F(PanoramaImage, FaultsNameTheFile) {
  const auto square = DecodePanorama(Write("square.png", cv::Mat(64, 64, CV_8UC1, cv::Scalar(1))),
                                     CameraMatching(100));
  EXPECT_EQ(square.status().code(), ErrorCode::kBadData);
  EXPECT_NE(square.status().message().find("square.png"), std::string::npos);
  std::ofstream(folder_ / "text.jpg") << "nothing";
  const auto text = DecodePanorama(folder_ / "text.jpg", CameraMatching(100));
  EXPECT_NE(text.status().message().find("text.jpg"), std::string::npos);
  EXPECT_EQ(DecodePanorama(folder_ / "none.jpg", CameraMatching(100)).status().code(),
            ErrorCode::kNotFound);
}

}  // namespace
}  // namespace panofix
