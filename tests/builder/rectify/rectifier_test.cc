#include "builder/rectify/rectifier.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <thread>

#include "common/geometry/attitude.h"
#include "tests/builder/ingest/gsv_writer.h"

namespace panofix {
namespace {

constexpr double kPi = std::numbers::pi;

Camera ViewCamera() { return Camera::FromHorizontalFov(160, 120, 75); }

Eigen::Vector3d RayInPano(const Camera& camera, const ViewDirection& direction, double x,
                          double y) {
  const Eigen::Vector2d n = camera.Normalize({x, y});
  return (PanoFromCam(direction) * Eigen::Vector3d(n.x(), n.y(), 1)).normalized();
}

// A picture whose value is a smooth function of direction, so that what a view must show is known.
double Brightness(const Eigen::Vector3d& ray) {
  return 128 + 60 * ray.x() + 35 * ray.y() * ray.z() + 25 * ray.z();
}

GrayImage SmoothPanorama(int width_px) {
  GrayImage image{width_px, width_px / 2, {}};
  for (int row = 0; row < image.height_px; ++row) {
    for (int column = 0; column < width_px; ++column) {
      const double azimuth = ((column + 0.5) / width_px - 0.5) * 2 * kPi;
      const double elevation = (0.5 - (row + 0.5) / image.height_px) * kPi;
      const Eigen::Vector3d ray(std::cos(elevation) * std::sin(azimuth),
                                std::cos(elevation) * std::cos(azimuth), std::sin(elevation));
      image.pixels.push_back(static_cast<std::uint8_t>(std::lround(Brightness(ray))));
    }
  }
  return image;
}

TEST(RingOfViews, StepsEvenly) {
  const auto ring = RingOfViews(8, 5, 10);
  ASSERT_EQ(ring.size(), 8U);
  EXPECT_EQ(ring[0].yaw_deg, 10);
  EXPECT_EQ(ring[3].yaw_deg, 145);
  EXPECT_EQ(ring[7].pitch_deg, 5);
  EXPECT_THROW(static_cast<void>(RingOfViews(0, 0)), std::invalid_argument);
}

TEST(PanoFromCam, AxesFollowTheConventions) {
  constexpr double kTolerance = 1e-12;  // a few roundings
  const Eigen::Matrix3d ahead = PanoFromCam({0, 0});
  EXPECT_TRUE(ahead.col(0).isApprox(Eigen::Vector3d(1, 0, 0), kTolerance));   // right
  EXPECT_TRUE(ahead.col(1).isApprox(Eigen::Vector3d(0, 0, -1), kTolerance));  // down
  EXPECT_TRUE(ahead.col(2).isApprox(Eigen::Vector3d(0, 1, 0), kTolerance));   // forward
  EXPECT_TRUE(PanoFromCam({90, 0}).col(2).isApprox(Eigen::Vector3d(1, 0, 0), kTolerance));
  EXPECT_TRUE(PanoFromCam({0, 90}).col(2).isApprox(Eigen::Vector3d(0, 0, 1), kTolerance));
  const Eigen::Vector3d axis = PanoFromCam({30, 20}).col(2);
  EXPECT_NEAR(std::atan2(axis.x(), axis.y()), 30 * kRadPerDeg, kTolerance);
  EXPECT_NEAR(std::asin(axis.z()), 20 * kRadPerDeg, kTolerance);
}

// Every pixel of every view against the direction it looks in: geometry, seam and both poles at
// once.
TEST(Rectifier, ViewsShowWhatTheirRaysMeet) {
  const GrayImage panorama = SmoothPanorama(720);
  std::vector<ViewDirection> directions = RingOfViews(8, 0);
  directions.insert(directions.end(), {{180, 25}, {-170, -30}, {13, 90}, {200, -90}, {725, 3}});
  const Rectifier rectifier(ViewCamera(), directions);
  constexpr double kRounding = 1.1;  // of the panorama's and the view's grey levels
  for (int view = 0; view < static_cast<int>(directions.size()); ++view) {
    const GrayImage image = rectifier.Cut(panorama, view);
    ASSERT_EQ(image.pixels.size(), 160U * 120U);
    for (int y = 0; y < 120; ++y) {
      for (int x = 0; x < 160; ++x) {
        const Eigen::Vector3d ray =
            RayInPano(ViewCamera(), directions[static_cast<std::size_t>(view)], x, y);
        ASSERT_NEAR(image.pixels[static_cast<std::size_t>(y * 160 + x)], Brightness(ray), kRounding)
            << "view " << view << " pixel " << x << "," << y;
      }
    }
  }
}

// Closed form: a landmark at a known azimuth and elevation appears where the camera projects it.
TEST(Rectifier, ALineAtTheSeamIsWhereItProjects) {
  constexpr int kWidth = 720;
  GrayImage panorama{kWidth, kWidth / 2, std::vector<std::uint8_t>(kWidth * kWidth / 2, 0)};
  for (int row = 0; row < kWidth / 2; ++row) {
    panorama.pixels[static_cast<std::size_t>(row * kWidth)] = 200;               // azimuth -179.75
    panorama.pixels[static_cast<std::size_t>(row * kWidth + kWidth - 1)] = 200;  // azimuth +179.75
  }
  const Camera camera = ViewCamera();
  const Rectifier rectifier(camera, {{160, 0}});
  const GrayImage view = rectifier.Cut(panorama, 0);
  double sum = 0, weighted = 0;
  for (int x = 0; x < camera.width_px; ++x) {
    const double value = view.pixels[static_cast<std::size_t>(60 * camera.width_px + x)];
    sum += value;
    weighted += value * x;
  }
  ASSERT_GT(sum, 0);
  // Azimuth 180 seen from yaw 160 stands 20 degrees right of the centre.
  const double expected_px = camera.cx_px + camera.fx_px * std::tan(20 * kRadPerDeg);
  constexpr double kTolerance_px = 0.1;  // a line two columns wide, sampled at 0.6 degrees a pixel
  EXPECT_NEAR(weighted / sum, expected_px, kTolerance_px);
}

TEST(Rectifier, SizesMayDiffer) {
  const Rectifier rectifier(ViewCamera(), {{45, 0}});
  const GrayImage fine = rectifier.Cut(SmoothPanorama(1440), 0);
  const GrayImage coarse = rectifier.Cut(SmoothPanorama(360), 0);
  constexpr int kMaxDifference = 2;  // rounding at both sizes
  for (std::size_t i = 0; i < fine.pixels.size(); ++i) {
    ASSERT_NEAR(fine.pixels[i], coarse.pixels[i], kMaxDifference);
  }
}

TEST(Rectifier, MasksAreCutNearestOfAnySize) {
  // Left half 255, right half 0; odd sizes, not 2:1.
  GrayImage mask{8, 3, {}};
  for (int i = 0; i < 24; ++i) mask.pixels.push_back(i % 8 < 4 ? 255 : 0);
  const Camera camera = ViewCamera();
  const std::vector<ViewDirection> directions = {{0, 0}, {180, 10}};
  const Rectifier rectifier(camera, directions);
  for (int view = 0; view < 2; ++view) {
    const GrayImage cut = rectifier.CutMask(mask, view);
    for (int y = 0; y < camera.height_px; ++y) {
      for (int x = 0; x < camera.width_px; ++x) {
        const Eigen::Vector3d ray =
            RayInPano(camera, directions[static_cast<std::size_t>(view)], x, y);
        const auto value = cut.pixels[static_cast<std::size_t>(y * camera.width_px + x)];
        ASSERT_EQ(value, ray.x() < 0 ? 255 : 0) << x << "," << y;
      }
    }
  }
}

// A box room: walls at +-3 m (x) and +-5 m (y), floor 2 m below, ceiling 1.5 m above.
TEST(Rectifier, ViewDepthOfARoomIsTheClosedForm) {
  constexpr int kWidth = 512, kHeight = 256;
  const std::vector<TestPlane> planes = {
      {}, {0, 0, -1, 2}, {0, 0, 1, 1.5F}, {1, 0, 0, 3}, {-1, 0, 0, 3}, {0, 1, 0, 5}, {0, -1, 0, 5}};
  const auto nearest = [&](const Eigen::Vector3d& ray) {
    std::size_t best = 0;
    double best_m = 1e9;
    for (std::size_t i = 1; i < planes.size(); ++i) {
      const double along = ray.dot(Eigen::Vector3d(planes[i].nx, planes[i].ny, planes[i].nz));
      if (along > 0 && planes[i].d_m / along < best_m) {
        best_m = planes[i].d_m / along;
        best = i;
      }
    }
    return std::pair(best, best_m);
  };
  std::vector<std::uint8_t> plane_idx;
  for (int row = 0; row < kHeight; ++row) {
    for (int column = 0; column < kWidth; ++column) {
      const double azimuth = ((column + 0.5) / kWidth - 0.5) * 2 * kPi;
      const double elevation = (0.5 - (row + 0.5) / kHeight) * kPi;
      plane_idx.push_back(static_cast<std::uint8_t>(
          nearest({std::cos(elevation) * std::sin(azimuth), std::cos(elevation) * std::cos(azimuth),
                   std::sin(elevation)})
              .first));
    }
  }
  const DepthMap map =
      DepthMap::DecodeGsv(Base64(GsvPayload(kWidth, kHeight, planes, plane_idx))).value();
  const Camera camera = ViewCamera();
  std::vector<ViewDirection> directions = RingOfViews(4, 0);
  directions.push_back({180, -40});
  const Rectifier rectifier(camera, directions);
  int num_off = 0, num_all = 0;
  for (int view = 0; view < 5; ++view) {
    const std::vector<float> z_m = rectifier.CutDepth(map, view);
    ASSERT_EQ(z_m.size(), 160U * 120U);
    for (int y = 0; y < 120; ++y) {
      for (int x = 0; x < 160; ++x, ++num_all) {
        const ViewDirection& direction = directions[static_cast<std::size_t>(view)];
        const Eigen::Vector3d ray = RayInPano(camera, direction, x, y);
        const double expected_m = nearest(ray).second * ray.dot(PanoFromCam(direction).col(2));
        if (std::abs(z_m[static_cast<std::size_t>(y * 160 + x)] - expected_m) > 1e-5) ++num_off;
      }
    }
  }
  // Exact but in the depth pixels through which an edge of the room runs.
  constexpr double kMaxEdgeShare = 0.04;
  EXPECT_LT(num_off, kMaxEdgeShare * num_all);
  EXPECT_GT(num_off, 0);
}

TEST(Rectifier, NoSurfaceIsZeroDepth) {
  const std::vector<std::uint8_t> nothing(16 * 8, 0);
  const DepthMap map =
      DepthMap::DecodeGsv(Base64(GsvPayload(16, 8, std::vector<TestPlane>(3), nothing))).value();
  const Rectifier rectifier(ViewCamera(), {{0, 0}});
  for (const float z_m : rectifier.CutDepth(map, 0)) ASSERT_EQ(z_m, 0);
}

TEST(Rectifier, ThreadsSeeTheSame) {
  const GrayImage panorama = SmoothPanorama(720);
  const Rectifier rectifier(ViewCamera(), RingOfViews(8, 10));
  std::vector<GrayImage> views(8);
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i) {
    threads.emplace_back(
        [&, i] { views[static_cast<std::size_t>(i)] = rectifier.Cut(panorama, i); });
  }
  for (std::thread& thread : threads) thread.join();
  for (int i = 0; i < 8; ++i) {
    EXPECT_EQ(views[static_cast<std::size_t>(i)].pixels, rectifier.Cut(panorama, i).pixels);
  }
}

TEST(Rectifier, CallersBugsThrow) {
  Camera distorted = ViewCamera();
  distorted.distortion[0] = 0.1;
  EXPECT_THROW(Rectifier(distorted, {{0, 0}}), std::invalid_argument);
  EXPECT_THROW(Rectifier(Camera(), {{0, 0}}), std::invalid_argument);
  EXPECT_THROW(Rectifier(ViewCamera(), {{0, 91}}), std::invalid_argument);
  EXPECT_THROW(Rectifier(ViewCamera(), {{std::nan(""), 0}}), std::invalid_argument);
  const Rectifier rectifier(ViewCamera(), {{0, 0}});
  EXPECT_THROW(static_cast<void>(rectifier.Cut(SmoothPanorama(64), 1)), std::out_of_range);
  EXPECT_THROW(static_cast<void>(rectifier.Cut(SmoothPanorama(64), -1)), std::out_of_range);
  EXPECT_THROW(static_cast<void>(rectifier.Cut(GrayImage(), 0)), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(rectifier.CutMask(GrayImage(), 0)), std::invalid_argument);
}

}  // namespace
}  // namespace panofix
