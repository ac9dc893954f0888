#include "builder/ingest/depth_map.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <limits>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "builder/ingest/depth_payload.h"
#include "common/base/rng.h"
#include "tests/builder/ingest/gsv_writer.h"

namespace panofix {
namespace {

using Bytes = std::vector<std::uint8_t>;

// 16 x 8: sky above, ground 2.5 m below, a wall 4 m ahead in the middle columns of the middle rows.
constexpr int kWidth = 16, kHeight = 8;
const std::vector<TestPlane> kScenePlanes = {{}, {0, 0, -1, 2.5F}, {0, 1, 0, 4}};

Bytes ScenePayload() {
  Bytes plane_idx(kWidth * kHeight, 0);
  for (int row = 0; row < kHeight; ++row) {
    for (int column = 0; column < kWidth; ++column) {
      auto& idx = plane_idx[static_cast<std::size_t>(row * kWidth + column)];
      if (row >= 5) idx = 1;
      if (row >= 2 && row < 5 && column >= 6 && column < 10) idx = 2;
    }
  }
  return GsvPayload(kWidth, kHeight, kScenePlanes, plane_idx);
}

DepthMap Scene() { return DepthMap::DecodeGsv(Base64(ScenePayload())).value(); }

// The status of a payload whose bytes [at, at + values) are overwritten.
Status Overwritten(std::size_t at, const Bytes& values) {
  Bytes payload = ScenePayload();
  std::copy(values.begin(), values.end(), payload.begin() + static_cast<std::ptrdiff_t>(at));
  return DepthMap::DecodeGsv(Base64(payload)).status();
}

TEST(DepthMap, EveryEncodingGivesTheSameMap) {
  const Bytes raw = ScenePayload();
  for (const bool is_zlib : {false, true}) {
    for (const bool url_safe : {false, true}) {
      for (const bool padded : {false, true}) {
        const std::string text =
            Base64(is_zlib ? ZlibCompressed(raw) : raw, url_safe, padded) + "\r\n";
        const auto map = DepthMap::DecodeGsv(text);
        ASSERT_TRUE(map.ok()) << map.status().message();
        EXPECT_EQ(map->is_zlib(), is_zlib);
        EXPECT_EQ(map->width(), kWidth);
        EXPECT_EQ(map->height(), kHeight);
        ASSERT_EQ(map->planes().size(), 3U);
        EXPECT_EQ(map->planes()[2].d_m, 4.0F);
        EXPECT_EQ(map->PlaneIndex(6, 2), 2);
        EXPECT_EQ(map->PlaneIndex(5, 2), 0);
      }
    }
  }
}

// 0x08 0x1D would pass as a zlib header too.
TEST(DepthMap, RawPayloadOf29PlanesIsNotTakenForZlib) {
  const Bytes raw =
      GsvPayload(kWidth, kHeight, std::vector<TestPlane>(29), Bytes(kWidth * kHeight, 0));
  ASSERT_EQ((raw[0] * 256 + raw[1]) % 31, 0);
  const auto map = DepthMap::DecodeGsv(Base64(raw));
  ASSERT_TRUE(map.ok()) << map.status().message();
  EXPECT_EQ(map->planes().size(), 29U);
}

TEST(DepthMap, PixelRaysFollowTheContract) {
  const DepthMap map = Scene();
  constexpr double kTolerance = 1e-12;  // a few roundings
  // The middle of the top-left quarter's edge: heading -90 degrees is column W/4 - 0.5.
  EXPECT_TRUE(map.PixelRay(kWidth / 2 - 0.5, kHeight / 2 - 0.5)
                  .isApprox(Eigen::Vector3d(0, 1, 0), kTolerance));
  EXPECT_TRUE(map.PixelRay(kWidth / 4 - 0.5, kHeight / 2 - 0.5)
                  .isApprox(Eigen::Vector3d(-1, 0, 0), kTolerance));
  EXPECT_TRUE(map.PixelRay(kWidth * 3 / 4 - 0.5, kHeight / 2 - 0.5)
                  .isApprox(Eigen::Vector3d(1, 0, 0), kTolerance));
  EXPECT_TRUE(map.PixelRay(3, -0.5).isApprox(Eigen::Vector3d(0, 0, 1), kTolerance));
  for (int row = 0; row < kHeight; ++row) {
    for (int column = 0; column < kWidth; ++column) {
      const auto by_ray = map.Cast(map.PixelRay(column, row)),
                 by_pixel = map.CastPixel(column, row);
      ASSERT_EQ(by_ray.has_value(), by_pixel.has_value());
      if (by_ray) {
        EXPECT_EQ(by_ray->surface_idx, by_pixel->surface_idx);
      }
    }
  }
}

TEST(DepthMap, RangeIsThePlanesOwnWithinAPixel) {
  const DepthMap map = Scene();
  for (const double column : {6.6, 7.0, 7.49, 9.2}) {
    const Eigen::Vector3d ray = map.PixelRay(column, 3.3);
    const auto hit = map.Cast(ray);
    ASSERT_TRUE(hit);
    EXPECT_NEAR((hit->range_m * ray).y(), 4.0, 1e-9);  // float planes of round numbers: exact
    EXPECT_EQ(hit->surface_idx, 2);
    EXPECT_LT(hit->normal_in_pano.dot(ray), 0);
    EXPECT_TRUE(hit->normal_in_pano.isApprox(Eigen::Vector3d(0, -1, 0)));
  }
  EXPECT_FALSE(map.Cast(Eigen::Vector3d(0, 0, 1)));
  EXPECT_NEAR(map.Cast(Eigen::Vector3d(0, 0, -1))->range_m, 2.5, 1e-12);
}

TEST(DepthMap, SummariesOfTheScene) {
  const DepthMap map = Scene();
  EXPECT_FALSE(map.is_placeholder());
  EXPECT_DOUBLE_EQ(map.SurfaceShare(), (3 * 16 + 3 * 4) / 128.0);
  EXPECT_EQ(map.GroundPlane(), 1);
}

TEST(DepthMap, TwoPlanesAreAPlaceholder) {
  const Bytes raw = GsvPayload(kWidth, kHeight, {{}, {0, 0, -1, 3}}, Bytes(kWidth * kHeight, 1));
  EXPECT_TRUE(DepthMap::DecodeGsv(Base64(raw))->is_placeholder());
  const Bytes empty = GsvPayload(kWidth, kHeight, {{}}, Bytes(kWidth * kHeight, 0));
  const DepthMap map = DepthMap::DecodeGsv(Base64(empty)).value();
  EXPECT_TRUE(map.is_placeholder());
  EXPECT_FALSE(map.GroundPlane());
  EXPECT_EQ(map.SurfaceShare(), 0);
}

TEST(DepthMap, DegeneratePlanesAreNoSurface) {
  const std::vector<TestPlane> planes = {{}, {0, 0, 0, 2}, {0, 1, 0, 0}, {0, 0, -1, 3}};
  for (const std::uint8_t idx : Bytes{1, 2}) {
    const auto map = DepthMap::DecodeGsv(
        Base64(GsvPayload(kWidth, kHeight, planes, Bytes(kWidth * kHeight, idx))));
    ASSERT_TRUE(map.ok());
    EXPECT_FALSE(map->CastPixel(8, 4)) << int{idx};
  }
}

TEST(DepthMap, PixelsOutsideAreTheCallersBug) {
  const DepthMap map = Scene();
  EXPECT_THROW(static_cast<void>(map.PlaneIndex(kWidth, 0)), std::out_of_range);
  EXPECT_THROW(static_cast<void>(map.CastPixel(0, -1)), std::out_of_range);
  EXPECT_FALSE(map.Cast(Eigen::Vector3d::Constant(std::nan(""))));
}

TEST(DepthMap, HeaderFaultsAreNamed) {
  EXPECT_NE(Overwritten(0, {9}).message().find("header size 9"), std::string::npos);
  EXPECT_NE(Overwritten(1, {0, 0}).message().find("0 planes"), std::string::npos);
  EXPECT_NE(Overwritten(1, {1, 1}).message().find("257 planes"), std::string::npos);
  EXPECT_NE(Overwritten(3, {0, 0}).message().find("twice the height"), std::string::npos);
  EXPECT_NE(Overwritten(3, {17, 0}).message().find("twice the height"), std::string::npos);
  EXPECT_EQ(Overwritten(3, {0, 0x40, 0, 0x20}).code(), ErrorCode::kTooLarge);
  EXPECT_NE(Overwritten(7, {7}).message().find("offset 7"), std::string::npos);
  EXPECT_NE(Overwritten(7, {24}).message().find("cut short"), std::string::npos);
  const Status bad_pixel = Overwritten(8 + kWidth + 5, {3});
  EXPECT_EQ(bad_pixel.code(), ErrorCode::kBadData);
  EXPECT_NE(bad_pixel.message().find("pixel 5,1 names plane 3 of 3"), std::string::npos);
}

TEST(DepthMap, PlanesMustBeFinite) {
  for (const float value :
       {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    std::vector<TestPlane> planes = kScenePlanes;
    planes[2].d_m = value;
    const auto payload = GsvPayload(kWidth, kHeight, planes, Bytes(kWidth * kHeight, 1));
    EXPECT_EQ(DepthMap::DecodeGsv(Base64(payload)).status().code(), ErrorCode::kBadData);
    planes[2].d_m = 1;
    planes[0].nx = value;  // unused, so whatever stands there
    EXPECT_TRUE(
        DepthMap::DecodeGsv(Base64(GsvPayload(kWidth, kHeight, planes, Bytes(kWidth * kHeight, 1))))
            .ok());
  }
}

TEST(DepthMap, TruncationAtEveryLengthFails) {
  const Bytes raw = ScenePayload();
  for (const Bytes& whole : {raw, ZlibCompressed(raw)}) {
    for (std::size_t length = 0; length < whole.size(); ++length) {
      const Bytes cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(length));
      ASSERT_FALSE(DepthMap::DecodeGsv(Base64(cut)).ok()) << length << " of " << whole.size();
    }
  }
}

TEST(DepthMap, TrailingBytesOnlyAsZeroPadding) {
  for (const bool is_zlib : {false, true}) {
    Bytes bytes = is_zlib ? ZlibCompressed(ScenePayload()) : ScenePayload();
    bytes.insert(bytes.end(), 15, 0);
    EXPECT_TRUE(DepthMap::DecodeGsv(Base64(bytes)).ok());
    bytes.push_back(0);
    EXPECT_FALSE(DepthMap::DecodeGsv(Base64(bytes)).ok());
    bytes.resize(bytes.size() - 2);
    bytes.back() = 1;
    EXPECT_FALSE(DepthMap::DecodeGsv(Base64(bytes)).ok());
  }
}

TEST(DepthMap, ZlibBombIsStopped) {
  const auto status = DepthMap::DecodeGsv(Base64(ZlibCompressed(Bytes(64 << 20, 8)))).status();
  EXPECT_EQ(status.code(), ErrorCode::kTooLarge) << status.message();
}

TEST(DepthMap, DamagedZlibFails) {
  Bytes packed = ZlibCompressed(ScenePayload());
  packed.back() ^= 1;  // of the Adler checksum
  EXPECT_EQ(DepthMap::DecodeGsv(Base64(packed)).status().code(), ErrorCode::kBadData);
}

TEST(DepthMap, Base64FaultsAreNamed) {
  std::string text = Base64(ScenePayload());
  EXPECT_FALSE(DepthMap::DecodeGsv("").ok());
  EXPECT_FALSE(DepthMap::DecodeGsv(" \n").ok());
  EXPECT_FALSE(DepthMap::DecodeGsv("=").ok());
  EXPECT_FALSE(DepthMap::DecodeGsv(text + "===").ok());
  EXPECT_FALSE(DepthMap::DecodeGsv("A").ok());
  text[17] = ' ';
  const Status status = DepthMap::DecodeGsv(text).status();
  EXPECT_EQ(status.code(), ErrorCode::kBadData);
  EXPECT_NE(status.message().find("position 17"), std::string::npos) << status.message();
  EXPECT_EQ(DepthMap::DecodeGsv(std::string(40 << 20, 'A')).status().code(), ErrorCode::kTooLarge);
}

TEST(DepthMap, RandomPayloadsNeverCrash) {
  Rng rng(1, "depth/random");
  for (int round = 0; round < 500; ++round) {
    Bytes payload = ScenePayload();
    for (int i = 0; i < 4; ++i) {
      payload[rng.Below(round % 2 == 0 ? payload.size() : 8)] =
          static_cast<std::uint8_t>(rng.Below(256));
    }
    const auto map = DepthMap::DecodeGsv(Base64(payload));
    if (!map.ok()) continue;
    for (int i = 0; i < 20; ++i) {
      const auto hit =
          map->Cast(Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal()).normalized());
      if (hit) {
        ASSERT_TRUE(std::isfinite(hit->range_m) && hit->range_m > 0);
      }
    }
  }
}

// Range raster of a room: walls 3 m left, right, ahead and behind, floor 2 m below, no ceiling.
DepthMap RoomRaster(double scale_m) {
  cv::Mat raster(256, 512, CV_16UC1);
  for (int row = 0; row < raster.rows; ++row) {
    for (int column = 0; column < raster.cols; ++column) {
      const double azimuth = ((column + 0.5) / 512 - 0.5) * 2 * std::numbers::pi;
      const double elevation = (0.5 - (row + 0.5) / 256) * std::numbers::pi;
      const double x = std::cos(elevation) * std::sin(azimuth),
                   y = std::cos(elevation) * std::cos(azimuth);
      double range_m = 3 / std::max(std::abs(x), std::abs(y));
      if (elevation < 0) range_m = std::min(range_m, -2 / std::sin(elevation));
      if (elevation > 1) range_m = 0;
      raster.at<std::uint16_t>(row, column) =
          static_cast<std::uint16_t>(std::lround(range_m / scale_m));
    }
  }
  Bytes bytes;
  cv::imencode(".png", raster, bytes);
  return DepthMap::DecodePng(bytes, scale_m).value();
}

TEST(DepthRaster, CastsBetweenPixelsOnASurface) {
  const DepthMap map = RoomRaster(0.0005);
  // Half a raster step, and inverse range bent by the sphere within a pixel of 0.7 degrees.
  constexpr double kMaxError_m = 0.002;
  for (const double column : {256.0, 256.37, 260.81, 250.5}) {
    const Eigen::Vector3d ray = map.PixelRay(column, 128.3);
    const auto hit = map.Cast(ray);
    ASSERT_TRUE(hit);
    EXPECT_NEAR((hit->range_m * ray).y(), 3.0, kMaxError_m);
    EXPECT_GT(hit->normal_in_pano.dot(Eigen::Vector3d(0, -1, 0)), 0.99);
    EXPECT_EQ(hit->surface_idx, 0);
  }
  const Eigen::Vector3d behind = map.PixelRay(-0.4, 128);  // across the seam
  ASSERT_TRUE(map.Cast(behind));
  EXPECT_NEAR((map.Cast(behind)->range_m * behind).y(), -3.0, kMaxError_m);
  const auto floor = map.Cast(Eigen::Vector3d(0, 0, -1));
  ASSERT_TRUE(floor);
  EXPECT_NEAR(floor->range_m, 2.0, kMaxError_m);
  EXPECT_FALSE(map.Cast(Eigen::Vector3d(0, 0, 1)));
}

TEST(DepthRaster, AnEdgeIsNotInterpolated) {
  cv::Mat raster(64, 128, CV_16UC1, cv::Scalar(10000));
  raster.colRange(64, 128).setTo(2000);
  Bytes bytes;
  cv::imencode(".png", raster, bytes);
  const DepthMap map = DepthMap::DecodePng(bytes, 0.001).value();
  EXPECT_NEAR(map.Cast(map.PixelRay(63.4, 32))->range_m, 10, 1e-6);  // float of 10
  EXPECT_NEAR(map.Cast(map.PixelRay(63.6, 32))->range_m, 2, 1e-6);
  EXPECT_EQ(map.SurfaceShare(), 1);
  EXPECT_FALSE(map.GroundPlane());
  EXPECT_FALSE(map.is_placeholder());
}

TEST(DepthRaster, RefusesOtherImagesAndScales) {
  Bytes grey, square, good;
  cv::imencode(".png", cv::Mat(8, 16, CV_8UC1, cv::Scalar(1)), grey);
  cv::imencode(".png", cv::Mat(16, 16, CV_16UC1, cv::Scalar(1)), square);
  cv::imencode(".png", cv::Mat(8, 16, CV_16UC1, cv::Scalar(1)), good);
  EXPECT_EQ(DepthMap::DecodePng(grey, 0.001).status().code(), ErrorCode::kBadData);
  EXPECT_EQ(DepthMap::DecodePng(square, 0.001).status().code(), ErrorCode::kBadData);
  EXPECT_EQ(DepthMap::DecodePng(good, 0).status().code(), ErrorCode::kInvalidArgument);
  EXPECT_TRUE(DepthMap::DecodePng(good, 0.001).ok());
}

TEST(DepthMapRead, NamesTheFile) {
  const auto folder = std::filesystem::path(testing::TempDir()) / "panofix_depth_read";
  std::filesystem::create_directories(folder);
  std::ofstream(folder / "a.gsv") << Base64(ScenePayload()) << "\n";
  std::ofstream(folder / "bad.gsv") << "AAAA";
  EXPECT_TRUE(DepthMap::Read(folder / "a.gsv", 0.001).ok());
  EXPECT_EQ(DepthMap::Read(folder / "none.gsv", 0.001).status().code(), ErrorCode::kNotFound);
  EXPECT_EQ(DepthMap::Read(folder / "a.exr", 0.001).status().code(), ErrorCode::kBadData);
  const Status bad = DepthMap::Read(folder / "bad.gsv", 0.001).status();
  EXPECT_EQ(bad.code(), ErrorCode::kBadData);
  EXPECT_NE(bad.message().find("bad.gsv"), std::string::npos);
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace panofix
