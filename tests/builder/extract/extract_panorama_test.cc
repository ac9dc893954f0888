#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "builder/extract/panorama_features.h"
#include "common/geometry/attitude.h"
#include "tests/builder/extract/box_world.h"
#include "tests/common/features/synthetic_image.h"
#include "tests/common/io/temp_folder.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

void WritePng(const fs::path& path, const GrayImage& image) {
  const cv::Mat view(image.height_px, image.width_px, CV_8UC1,
                     const_cast<std::uint8_t*>(image.pixels.data()));
  ASSERT_TRUE(cv::imwrite(path.string(), view));
}

// A panorama of blobs in a room, on disk.
class ExtractPanoramaTest : public testing::Test {
 protected:
  ExtractPanoramaTest() : rectifier_(Camera::FromHorizontalFov(240, 180, 80), RingOfViews(4, 0)) {
    record_.id = "p";
    record_.image = folder_ / "p.png";
    record_.depth = folder_ / "p.gsv";
    static const GrayImage image = BusyImage(960, 480, 1);
    static const std::string gsv = Room::Gsv();
    WritePng(record_.image, image);
    WriteText(record_.depth, gsv);
    options_.features.max_sift = 300;
    options_.features.max_mser = 50;
  }
  [[nodiscard]] Result<PanoramaFeatures> Extract() const {
    return ExtractPanorama(record_, rectifier_, options_);
  }
  TempFolder folder_;
  PanoramaRecord record_;
  Rectifier rectifier_;
  ExtractOptions options_;
};

TEST_F(ExtractPanoramaTest, PointsLieOnTheRoomAlongTheirKeypointsRays) {
  const auto features = Extract();
  ASSERT_TRUE(features.ok()) << features.status().message();
  EXPECT_TRUE(features->has_depth);
  EXPECT_EQ(features->depth_fault, "");
  EXPECT_EQ(features->sources, std::vector<std::string>{"p"});
  EXPECT_EQ(features->planes.size(), 6U);
  ASSERT_EQ(features->views.size(), 4U);
  int num_points = 0;
  for (std::size_t v = 0; v < 4; ++v) {
    const ViewFeatureSet& view = features->views[v];
    ASSERT_EQ(view.points.size(), view.sift.size());
    EXPECT_GT(view.sift.size(), 50U);
    EXPECT_GT(view.mser.size(), 5U);
    for (std::size_t i = 0; i < view.sift.size(); ++i) {
      if (view.points[i].range_sigma_m == 0) continue;
      ++num_points;
      EXPECT_EQ(view.points[i].source_idx, 0);
      const Eigen::Vector3d point = view.points[i].point_in_pano.cast<double>();
      // Back through the view's camera, 90 degrees of yaw a view, clockwise.
      const double yaw = 90.0 * static_cast<double>(v) * kRadPerDeg;
      const double forward = std::sin(yaw) * point.x() + std::cos(yaw) * point.y();
      const double right = std::cos(yaw) * point.x() - std::sin(yaw) * point.y();
      const auto px = rectifier_.camera().Project({right, -point.z(), forward});
      ASSERT_TRUE(px);
      EXPECT_NEAR(px->x(), double{view.sift.keypoints[i].x_px}, 1e-3);
      EXPECT_NEAR(px->y(), double{view.sift.keypoints[i].y_px}, 1e-3);
      const TestPlane p =
          Room::Planes().at(static_cast<std::size_t>(view.points[i].surface_idx - 1));
      EXPECT_NEAR(double{p.nx} * point.x() + double{p.ny} * point.y() + double{p.nz} * point.z(),
                  double{p.d_m}, 1e-4);
    }
  }
  EXPECT_GT(num_points, 100);
}

TEST_F(ExtractPanoramaTest, IsDeterministic) {
  const auto a = Extract(), b = Extract();
  ASSERT_TRUE(a.ok() && b.ok());
  for (std::size_t v = 0; v < 4; ++v) {
    EXPECT_EQ(a->views[v].sift.descriptors, b->views[v].sift.descriptors);
    EXPECT_EQ(a->views[v].mser.descriptors, b->views[v].mser.descriptors);
  }
}

TEST_F(ExtractPanoramaTest, TheMaskDropsFeatures) {
  const auto all = Extract();
  // The right half of the panorama and of its ground: a mask of another size than the image.
  GrayImage mask{200, 100, std::vector<std::uint8_t>(20000, 0)};
  for (std::size_t y = 0; y < 100; ++y) {
    for (std::size_t x = 100; x < 200; ++x) mask.pixels[y * 200 + x] = 1;
  }
  record_.mask = folder_ / "mask.png";
  WritePng(record_.mask, mask);
  const auto masked = Extract();
  ASSERT_TRUE(all.ok() && masked.ok()) << masked.status().message();
  EXPECT_EQ(masked->views[1].sift.size(), 0U);  // looks right
  EXPECT_EQ(masked->views[1].mser.size(), 0U);
  EXPECT_EQ(masked->views[3].sift.descriptors, all->views[3].sift.descriptors);  // looks left
  // Ahead, exactly the left half of the picture is kept.
  const FeatureSet &before = all->views[0].sift, &after = masked->views[0].sift;
  std::size_t kept = 0;
  for (const Keypoint& k : before.keypoints) kept += std::lround(k.x_px) < 120;
  EXPECT_EQ(after.size(), kept);
  EXPECT_EQ(masked->views[0].points.size(), kept);
  EXPECT_GT(kept, 20U);
}

TEST_F(ExtractPanoramaTest, WithoutDepthThereAreNoPoints) {
  const auto expect_none = [&](const std::string& fault_word) {
    const auto features = Extract();
    ASSERT_TRUE(features.ok()) << features.status().message();
    EXPECT_FALSE(features->has_depth);
    EXPECT_EQ(features->depth_fault.empty(), fault_word.empty());
    EXPECT_NE(features->depth_fault.find(fault_word), std::string::npos) << features->depth_fault;
    EXPECT_GT(features->views[0].sift.size(), 50U);
    for (const ViewFeatureSet& view : features->views) {
      ASSERT_EQ(view.points.size(), view.sift.size());
      for (const SurfacePoint& point : view.points) EXPECT_EQ(point.range_sigma_m, 0.0F);
    }
  };
  WriteText(record_.depth, "AAAA");
  expect_none("p.gsv");
  WriteText(record_.depth, GsvText({{0, 0, -1, 2.5}}, [](const Eigen::Vector3d&) { return 1; }));
  expect_none("placeholder");
  fs::remove(record_.depth);
  expect_none("p.gsv");
  record_.depth.clear();
  expect_none("");
}

TEST_F(ExtractPanoramaTest, UnusableImagesAreSetAside) {
  const auto fails_with = [&](const char* word) {
    const Status status = Extract().status();
    EXPECT_FALSE(status.ok());
    EXPECT_NE(status.message().find(word), std::string::npos) << status.message();
  };
  WritePng(record_.image, BlobImage(200, 150, {}));
  fails_with("p.png");
  WriteText(record_.image, "no picture");
  fails_with("p.png");
  fs::remove(record_.image);
  fails_with("p.png");
}

TEST_F(ExtractPanoramaTest, AStatedMaskMustBeReadable) {
  record_.mask = folder_ / "mask.png";
  EXPECT_FALSE(Extract().ok());
  WriteText(record_.mask, "no picture");
  const Status status = Extract().status();
  EXPECT_FALSE(status.ok());
  EXPECT_NE(status.message().find("mask.png"), std::string::npos) << status.message();
}

}  // namespace
}  // namespace panofix
