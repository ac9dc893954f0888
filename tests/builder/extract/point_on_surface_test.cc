#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <stdexcept>

#include "builder/extract/panorama_features.h"
#include "common/base/rng.h"
#include "common/geometry/attitude.h"
#include "tests/builder/extract/box_world.h"

namespace panofix {
namespace {

constexpr double kFloat = 1e-5;  // of metres stored as floats

DepthMap Decode(const std::string& gsv) { return ValueOrThrow(DepthMap::DecodeGsv(gsv)); }

Eigen::Vector3d Ray(double azimuth_deg, double elevation_deg) {
  const double a = azimuth_deg * kRadPerDeg, e = elevation_deg * kRadPerDeg;
  return {std::cos(e) * std::sin(a), std::cos(e) * std::cos(a), std::sin(e)};
}

// True where a depth pixel's width around the ray shows the same surface.
bool IsInside(const Eigen::Vector3d& ray) {
  double range_m;
  const int plane = Room::Nearest(ray, &range_m);
  const Eigen::Vector3d u = ray.unitOrthogonal(), v = ray.cross(u);
  for (int k = 0; k < 16; ++k) {
    const double angle = k * M_PI / 8;
    const Eigen::Vector3d beside = ray + 0.03 * (std::cos(angle) * u + std::sin(angle) * v);
    if (Room::Nearest(beside.normalized(), &range_m) != plane) return false;
  }
  return true;
}

// sigma^2 = (share r)^2 + (r tan(theta) normal)^2 + (relief / cos(theta))^2.
double ClosedFormSigma(double range_m, double cosine, const MapErrors& errors) {
  const double tangent = std::sqrt(1 - cosine * cosine) / cosine;
  const double distance = errors.range_sigma_share * range_m;
  const double normal = range_m * tangent * errors.normal_sigma_deg * kRadPerDeg;
  const double relief = errors.relief_sigma_m / cosine;
  return std::sqrt(distance * distance + normal * normal + relief * relief);
}

TEST(PointOnSurface, IsTheClosedFormInARoom) {
  const DepthMap depth = Decode(Room::Gsv());
  ExtractOptions options;
  Rng rng(1, "tests/room");
  int num_points = 0, num_sky = 0;
  for (int i = 0; i < 3000; ++i) {
    const Eigen::Vector3d ray = Ray(rng.Uniform(-180, 180), rng.Uniform(-80, 60));
    if (!IsInside(ray)) continue;
    double range_m;
    const int plane = Room::Nearest(ray, &range_m);
    const auto point = PointOnSurface(depth, ray, options);
    if (plane == 0) {
      ++num_sky;
      EXPECT_FALSE(point);
      continue;
    }
    const TestPlane p = Room::Planes()[static_cast<std::size_t>(plane - 1)];
    const double cosine =
        std::abs(ray.dot(Eigen::Vector3d(double{p.nx}, double{p.ny}, double{p.nz})));
    ASSERT_TRUE(point) << ray.transpose();
    ++num_points;
    EXPECT_LE((point->point_in_pano.cast<double>() - range_m * ray).norm(), kFloat);
    EXPECT_NEAR(double{point->range_sigma_m}, ClosedFormSigma(range_m, cosine, options.errors),
                kFloat);
    EXPECT_EQ(point->surface_idx, plane);
  }
  EXPECT_GT(num_points, 1000);
  EXPECT_GT(num_sky, 100);
}

// Straight at a wall only the plane's distance and its relief matter.
TEST(PointOnSurface, EachErrorTermStandsAlone) {
  const DepthMap depth = Decode(Room::Gsv());
  ExtractOptions options;
  const auto sigma = [&](const MapErrors& errors, const Eigen::Vector3d& ray) {
    options.errors = errors;
    return double{PointOnSurface(depth, ray, options).value().range_sigma_m};
  };
  MapErrors none;
  none.range_sigma_share = none.normal_sigma_deg = none.relief_sigma_m = 0;
  MapErrors share = none, normal = none, relief = none;
  share.range_sigma_share = 0.1, normal.normal_sigma_deg = 1, relief.relief_sigma_m = 0.5;
  const Eigen::Vector3d straight = Ray(90, 0), slanted = Ray(60, 0);  // the wall 6 m to the right
  EXPECT_NEAR(sigma(none, straight), 1e-3, kFloat);                   // never exactly certain
  EXPECT_NEAR(sigma(share, straight), 0.6, kFloat);
  EXPECT_NEAR(sigma(normal, straight), 1e-3, kFloat);
  EXPECT_NEAR(sigma(relief, straight), 0.5, kFloat);
  const double cosine = std::cos(30 * kRadPerDeg), range_m = 6 / cosine;
  EXPECT_NEAR(sigma(share, slanted), 0.1 * range_m, kFloat);
  EXPECT_NEAR(sigma(normal, slanted), range_m * std::tan(30 * kRadPerDeg) * kRadPerDeg, kFloat);
  EXPECT_NEAR(sigma(relief, slanted), 0.5 / cosine, kFloat);
}

// A near wall covers the left half of the view of a far one: within a depth pixel of its edge a
// keypoint may be on either.
TEST(PointOnSurface, ADepthEdgeMakesTheRangeUncertain) {
  const DepthMap depth =
      Decode(GsvText({{0, 1, 0, 4}, {0, 1, 0, 20}, {0, 0, -1, 2.5}},
                     [](const Eigen::Vector3d& ray) { return ray.x() < 0 ? 1 : 2; }));
  const ExtractOptions options;
  const auto sigma = [&](double azimuth_deg) {
    return double{PointOnSurface(depth, Ray(azimuth_deg, 0), options).value().range_sigma_m};
  };
  const double pixel_deg = 360.0 / kDepthWidth;
  // Half of the step of 16 m, and little else.
  EXPECT_NEAR(sigma(-0.5 * pixel_deg), 8, 0.1);
  EXPECT_NEAR(sigma(0.5 * pixel_deg), 8, 0.1);
  EXPECT_LT(sigma(-2 * pixel_deg), 0.3);
  EXPECT_LT(sigma(2 * pixel_deg), 0.6);
}

TEST(PointOnSurface, TheSkyBesideARoofIsNoRivalSurface) {
  const DepthMap depth =
      Decode(GsvText({{0, 1, 0, 10}, {0, 0, -1, 2.5}},
                     [](const Eigen::Vector3d& ray) { return ray.x() < 0 ? 1 : 0; }));
  const ExtractOptions options;
  const auto at_edge = PointOnSurface(depth, Ray(-0.2, 0), options);
  ASSERT_TRUE(at_edge);
  EXPECT_NEAR(double{at_edge->range_sigma_m}, ClosedFormSigma(10, 1, options.errors), 1e-3);
}

TEST(PointOnSurface, FarAndObliqueSurfacesGiveNoPoint) {
  const DepthMap depth = Decode(Room::Gsv());
  ExtractOptions options;
  options.max_range_m = 8;
  EXPECT_TRUE(PointOnSurface(depth, Ray(90, 0), options));    // 6 m
  EXPECT_FALSE(PointOnSurface(depth, Ray(0, 0), options));    // 9 m
  EXPECT_FALSE(PointOnSurface(depth, Ray(180, 0), options));  // 11 m
  options.max_range_m = 80, options.max_incidence_deg = 40;
  EXPECT_TRUE(PointOnSurface(depth, Ray(90 - 39, 0), options));
  EXPECT_FALSE(PointOnSurface(depth, Ray(90 - 41, 0), options));
}

TEST(ExtractOptions, CheckNamesTheField) {
  EXPECT_NO_THROW(ExtractOptions().Check());
  const auto refused = [](const std::function<void(ExtractOptions*)>& change) {
    ExtractOptions options;
    change(&options);
    EXPECT_THROW(options.Check(), std::invalid_argument);
  };
  refused([](ExtractOptions* o) { o->max_range_m = 0; });
  refused([](ExtractOptions* o) { o->max_range_m = std::nan(""); });
  refused([](ExtractOptions* o) { o->max_incidence_deg = 90; });
  refused([](ExtractOptions* o) { o->max_incidence_deg = 0; });
  refused([](ExtractOptions* o) { o->errors.relief_sigma_m = -0.1; });
  refused([](ExtractOptions* o) { o->errors.normal_sigma_deg = std::nan(""); });
  refused([](ExtractOptions* o) { o->features.max_sift = 1; });
}

}  // namespace
}  // namespace panofix
