#include "common/image/gray_image.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "common/base/rng.h"

namespace panofix {
namespace {

using Bytes = std::vector<std::uint8_t>;

// Smooth, so that JPEG's losses stay small.
cv::Mat SmoothPicture(int width_px, int height_px) {
  cv::Mat mat(height_px, width_px, CV_8UC1);
  for (int y = 0; y < height_px; ++y) {
    for (int x = 0; x < width_px; ++x) {
      mat.at<std::uint8_t>(y, x) =
          static_cast<std::uint8_t>(128 + 60 * std::sin(x * 0.05) + 50 * std::cos(y * 0.07));
    }
  }
  return mat;
}

Bytes Encode(const char* extension, const cv::Mat& mat, std::vector<int> parameters = {}) {
  Bytes bytes;
  EXPECT_TRUE(cv::imencode(extension, mat, bytes, parameters));
  return bytes;
}

Bytes Jpeg(const cv::Mat& mat) { return Encode(".jpg", mat, {cv::IMWRITE_JPEG_QUALITY, 95}); }

Bytes ProgressiveJpeg(const cv::Mat& mat) {
  return Encode(".jpg", mat,
                {cv::IMWRITE_JPEG_QUALITY, 95, cv::IMWRITE_JPEG_PROGRESSIVE, 1,
                 cv::IMWRITE_JPEG_RST_INTERVAL, 4});
}

// Intensity-weighted centroid, in pixel centres.
cv::Point2d Centroid(const GrayImage& image) {
  double sum = 0, sum_x = 0, sum_y = 0;
  for (int y = 0; y < image.height_px; ++y) {
    for (int x = 0; x < image.width_px; ++x) {
      // Less JPEG's ringing around the spot; going to 0 gently, so that no pixel's side of a bound
      // counts.
      const double value =
          std::max(0.0, image.pixels[static_cast<std::size_t>(y * image.width_px + x)] - 8.0);
      sum += value;
      sum_x += value * x;
      sum_y += value * y;
    }
  }
  return {sum_x / sum, sum_y / sum};
}

void WriteFile(const std::filesystem::path& path, const Bytes& bytes) {
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()),
             static_cast<std::streamsize>(bytes.size()));
}

TEST(ImageHeader, ReadsSizeOfJpegAndPng) {
  const cv::Mat picture = SmoothPicture(123, 77);
  for (const Bytes& bytes : {Jpeg(picture), ProgressiveJpeg(picture), Encode(".png", picture)}) {
    const auto size = ReadImageSize(bytes);
    ASSERT_TRUE(size.ok()) << size.status().message();
    EXPECT_EQ(size->width_px, 123);
    EXPECT_EQ(size->height_px, 77);
  }
}

TEST(DecodeGray, PngIsExact) {
  const cv::Mat picture = SmoothPicture(101, 50);
  const auto image = DecodeGray(Encode(".png", picture));
  ASSERT_TRUE(image.ok()) << image.status().message();
  ASSERT_EQ(image->pixels.size(), picture.total());
  EXPECT_TRUE(
      std::equal(image->pixels.begin(), image->pixels.end(), picture.begin<std::uint8_t>()));
}

TEST(DecodeGray, JpegIsCloseInBothForms) {
  const cv::Mat picture = SmoothPicture(160, 96);
  for (const Bytes& bytes : {Jpeg(picture), ProgressiveJpeg(picture)}) {
    const auto image = DecodeGray(bytes);
    ASSERT_TRUE(image.ok()) << image.status().message();
    constexpr int kMaxLoss = 6;  // quality 95 on a smooth picture
    int index = 0;
    for (const std::uint8_t expected : cv::Mat_<std::uint8_t>(picture)) {
      ASSERT_NEAR(image->pixels[static_cast<std::size_t>(index++)], expected, kMaxLoss);
    }
  }
}

TEST(DecodeGray, ReducedSizesRoundUp) {
  const cv::Mat picture = SmoothPicture(101, 51);
  for (const Bytes& bytes : {Jpeg(picture), Encode(".png", picture)}) {
    for (const int reduction : {1, 2, 4, 8}) {
      const auto image = DecodeGray(bytes, reduction);
      ASSERT_TRUE(image.ok()) << image.status().message();
      EXPECT_EQ(image->width_px, (101 + reduction - 1) / reduction);
      EXPECT_EQ(image->height_px, (51 + reduction - 1) / reduction);
    }
  }
}

// A spot's angle must not depend on the reduction: pixel (c, r) covers its block of the original.
TEST(DecodeGray, ReductionKeepsFeaturesInPlace) {
  cv::Mat picture(256, 512, CV_8UC1);
  const cv::Point2d spot(301.3, 97.8);
  for (int y = 0; y < picture.rows; ++y) {
    for (int x = 0; x < picture.cols; ++x) {
      const double d2 = (x - spot.x) * (x - spot.x) + (y - spot.y) * (y - spot.y);
      picture.at<std::uint8_t>(y, x) =
          static_cast<std::uint8_t>(230 * std::exp(-d2 / (2 * 15 * 15)));
    }
  }
  constexpr double kMaxShift_px = 0.1;  // of the full-size picture
  for (const Bytes& bytes : {Jpeg(picture), Encode(".png", picture)}) {
    const auto full = DecodeGray(bytes);
    ASSERT_TRUE(full.ok());
    const cv::Point2d expected = Centroid(*full);
    for (const int reduction : {2, 4, 8}) {
      const auto image = DecodeGray(bytes, reduction);
      ASSERT_TRUE(image.ok());
      const cv::Point2d centroid = Centroid(*image);
      EXPECT_NEAR((centroid.x + 0.5) * reduction - 0.5, expected.x, kMaxShift_px) << reduction;
      EXPECT_NEAR((centroid.y + 0.5) * reduction - 0.5, expected.y, kMaxShift_px) << reduction;
    }
  }
}

TEST(DecodeGray, OrientationTagIsIgnored) {
  Bytes bytes = Jpeg(SmoothPicture(64, 32));
  const Bytes rotated_by_90 = {0xFF, 0xE1, 0x00, 0x22, 'E', 'x', 'i', 'f', 0,    0,    'M', 'M',
                               0,    0x2A, 0,    0,    0,   8,   0,   1,   0x01, 0x12, 0,   3,
                               0,    0,    0,    1,    0,   6,   0,   0,   0,    0,    0,   0};
  bytes.insert(bytes.begin() + 2, rotated_by_90.begin(), rotated_by_90.end());
  const auto image = DecodeGray(bytes);
  ASSERT_TRUE(image.ok()) << image.status().message();
  EXPECT_EQ(image->width_px, 64);
  EXPECT_EQ(image->height_px, 32);
}

TEST(DecodeGray, ColourBecomesGrey) {
  const cv::Mat red(16, 16, CV_8UC3, cv::Scalar(0, 0, 255));
  for (const Bytes& bytes : {Encode(".jpg", red), Encode(".png", red)}) {
    const auto image = DecodeGray(bytes);
    ASSERT_TRUE(image.ok());
    EXPECT_NEAR(image->pixels[100], 76, 2);  // 0.299 * 255, rounded by codec
  }
}

TEST(DecodeGray, BytesAfterTheEndAreTolerated) {
  for (Bytes bytes : {Jpeg(SmoothPicture(64, 32)), Encode(".png", SmoothPicture(64, 32))}) {
    bytes.insert(bytes.end(), 1000, 0xAB);
    EXPECT_TRUE(DecodeGray(bytes).ok());
  }
}

TEST(DecodeGray, TruncationAtEveryLengthFails) {
  const cv::Mat picture = SmoothPicture(96, 48);
  for (const Bytes& bytes : {Jpeg(picture), ProgressiveJpeg(picture), Encode(".png", picture)}) {
    for (std::size_t length = 0; length < bytes.size(); ++length) {
      const auto image = DecodeGray(std::span(bytes).first(length));
      ASSERT_FALSE(image.ok()) << length << " of " << bytes.size();
      ASSERT_EQ(image.status().code(), ErrorCode::kBadData);
    }
  }
}

// A picture that ends early but has its end marker: the decoder would fill the rest with grey.
TEST(DecodeGray, JpegWithItsMiddleMissingFails) {
  Bytes bytes = Jpeg(SmoothPicture(256, 128));
  bytes.erase(bytes.begin() + static_cast<std::ptrdiff_t>(bytes.size() * 3 / 4), bytes.end() - 2);
  for (const int reduction : {1, 8}) {
    EXPECT_EQ(DecodeGray(bytes, reduction).status().code(), ErrorCode::kBadData);
  }
}

TEST(DecodeGray, StrayBytesBetweenSegmentsLoseNothing) {
  Bytes bytes = Jpeg(SmoothPicture(64, 32));
  const Bytes stray = {0x12, 0x34};
  bytes.insert(bytes.end() - 2, stray.begin(), stray.end());
  EXPECT_TRUE(DecodeGray(bytes).ok());
}

TEST(DecodeGray, EndlessScansAreRefused) {
  Bytes bytes = Jpeg(SmoothPicture(64, 32));
  const Bytes scan = {0xFF, 0xDA, 0x00, 0x08, 1, 1, 0, 0, 0x3F, 0};
  for (int i = 0; i < 300; ++i) bytes.insert(bytes.end() - 2, scan.begin(), scan.end());
  EXPECT_EQ(DecodeGray(bytes).status().code(), ErrorCode::kTooLarge);
}

TEST(DecodeGray, DamagedPngFails) {
  const Bytes good = Encode(".png", SmoothPicture(64, 32));
  for (std::size_t i = 0; i < good.size(); ++i) {
    Bytes bytes = good;
    bytes[i] ^= 0x10;
    ASSERT_FALSE(DecodeGray(bytes).ok()) << i;
  }
}

TEST(DecodeGray, LimitsAreCheckedBeforeDecoding) {
  const Bytes bytes = Jpeg(SmoothPicture(64, 32));
  DecodeLimits limits;
  limits.max_pixels = 64 * 32 - 1;
  EXPECT_EQ(DecodeGray(bytes, 1, limits).status().code(), ErrorCode::kTooLarge);
  limits.max_pixels = 64 * 32;
  EXPECT_TRUE(DecodeGray(bytes, 1, limits).ok());
  limits.max_bytes = bytes.size() - 1;
  EXPECT_EQ(DecodeGray(bytes, 1, limits).status().code(), ErrorCode::kTooLarge);
}

TEST(DecodeGray, RefusesWhatItCannotRead) {
  EXPECT_EQ(DecodeGray({}).status().code(), ErrorCode::kBadData);
  const Bytes gif = {'G', 'I', 'F', '8', '9', 'a', 1, 0, 1, 0};
  EXPECT_EQ(DecodeGray(gif).status().code(), ErrorCode::kBadData);
  EXPECT_EQ(DecodeGray(Encode(".bmp", SmoothPicture(8, 8))).status().code(), ErrorCode::kBadData);
  EXPECT_EQ(DecodeGray(Jpeg(SmoothPicture(8, 8)), 3).status().code(), ErrorCode::kInvalidArgument);
}

// A PNG of 300 bytes that claims 20000 x 20000: checksums right, content missing.
TEST(DecodeGray, RefusesAPngTooSmallForItsSize) {
  Bytes bytes = Encode(".png", SmoothPicture(8, 8));
  const Bytes claim = {0, 0, 0x4E, 0x20, 0, 0, 0x4E, 0x20};
  std::copy(claim.begin(), claim.end(), bytes.begin() + 16);
  std::uint32_t crc = 0xFFFFFFFF;  // PNG's checksum, bit by bit
  for (std::size_t i = 12; i < 29; ++i) {
    crc ^= bytes[i];
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ (crc & 1 ? 0xEDB88320 : 0);
  }
  crc = ~crc;
  for (int i = 0; i < 4; ++i)
    bytes[static_cast<std::size_t>(29 + i)] = static_cast<std::uint8_t>(crc >> (24 - 8 * i));
  const auto image = DecodeGray(bytes);
  ASSERT_FALSE(image.ok());
  EXPECT_NE(image.status().message().find("too little data"), std::string::npos)
      << image.status().message();
}

TEST(DecodeGray, RandomDamageNeverCrashes) {
  const Bytes good = Jpeg(SmoothPicture(64, 48));
  DecodeLimits limits;
  limits.max_pixels = 1 << 20;
  Rng rng(1, "image/damage");
  for (int round = 0; round < 300; ++round) {
    Bytes bytes = good;
    for (int i = 0; i < 3; ++i)
      bytes[rng.Below(bytes.size())] = static_cast<std::uint8_t>(rng.Below(256));
    const auto image = DecodeGray(bytes, 1 << rng.Below(4), limits);
    if (!image.ok()) continue;
    ASSERT_EQ(image->pixels.size(), static_cast<std::size_t>(image->width_px * image->height_px));
  }
}

TEST(DecodePng16, IsExact) {
  cv::Mat picture(30, 60, CV_16UC1);
  int value = 0;
  for (std::uint16_t& pixel : cv::Mat_<std::uint16_t>(picture)) {
    pixel = static_cast<std::uint16_t>(value += 36);
  }
  const auto image = DecodePng16(Encode(".png", picture));
  ASSERT_TRUE(image.ok()) << image.status().message();
  EXPECT_EQ(image->width_px, 60);
  EXPECT_TRUE(
      std::equal(image->pixels.begin(), image->pixels.end(), picture.begin<std::uint16_t>()));
}

TEST(DecodePng16, RefusesOtherImages) {
  const cv::Mat grey = SmoothPicture(60, 30);
  cv::Mat color16;
  cv::merge(std::vector<cv::Mat>(3, cv::Mat(30, 60, CV_16UC1, cv::Scalar(5))), color16);
  for (const Bytes& bytes : {Encode(".png", grey), Jpeg(grey), Encode(".png", color16)}) {
    EXPECT_EQ(DecodePng16(bytes).status().code(), ErrorCode::kBadData);
  }
}

TEST(ReadFileBytes, ReadsAndNamesFaults) {
  const auto folder = std::filesystem::path(testing::TempDir()) / "panofix_read_file_bytes";
  std::filesystem::create_directories(folder);
  WriteFile(folder / "a.bin", {1, 2, 3});
  const auto bytes = ReadFileBytes(folder / "a.bin", 3);
  ASSERT_TRUE(bytes.ok());
  EXPECT_EQ(*bytes, (Bytes{1, 2, 3}));
  EXPECT_EQ(ReadFileBytes(folder / "a.bin", 2).status().code(), ErrorCode::kTooLarge);
  EXPECT_EQ(ReadFileBytes(folder, 10).status().code(), ErrorCode::kIo);
  const Status missing = ReadFileBytes(folder / "b.bin", 10).status();
  EXPECT_EQ(missing.code(), ErrorCode::kNotFound);
  EXPECT_NE(missing.message().find("b.bin"), std::string::npos);
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace panofix
