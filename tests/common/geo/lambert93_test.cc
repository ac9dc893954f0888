// Lambert-93 (EPSG:2154) against what its maker publishes: IGN, NTG 71, "Projections coniques
// conformes", algorithm ALG0003 with the constants of the table for Lambert-93.
#include <gtest/gtest.h>

#include <cmath>

#include "common/geo/map_frame.h"
#include "common/geometry/attitude.h"

namespace panofix {
namespace {

constexpr double kN = 0.7256077650, kC_m = 11754255.426;
constexpr double kXs_m = 700000.0, kYs_m = 12655612.050;
// The published n has 10 digits and C a millimetre: some 0.5 mm each.
constexpr double kPublished_m = 2e-3;

// ALG0001, ALG0003: isometric latitude, then polar coordinates about the cone's apex.
Eigen::Vector2d IgnLambert93(double lat_deg, double lon_deg) {
  constexpr double kE = 0.08181919112;
  const double sine = std::sin(lat_deg * kRadPerDeg);
  const double isometric = std::atanh(sine) - kE * std::atanh(kE * sine);
  const double radius_m = kC_m * std::exp(-kN * isometric);
  const double angle_rad = kN * (lon_deg - 3) * kRadPerDeg;
  return {kXs_m + radius_m * std::sin(angle_rad), kYs_m - radius_m * std::cos(angle_rad)};
}

TEST(Lambert93, OriginIsThePublishedFalseOrigin) {
  const Eigen::Vector3d origin = MapFrame::FromName("EPSG:2154")->ToMap({46.5, 3, 0});
  EXPECT_NEAR(origin.x(), 700000, 1e-6);
  EXPECT_NEAR(origin.y(), 6600000, 1e-6);
}

TEST(Lambert93, GridAgreesWithThePublishedAlgorithm) {
  const MapFrame frame = *MapFrame::FromName("EPSG:2154");
  for (double lat_deg = 41.5; lat_deg <= 51; lat_deg += 0.95) {
    for (double lon_deg = -5; lon_deg <= 9.5; lon_deg += 1.45) {
      const Eigen::Vector3d grid = frame.ToMap({lat_deg, lon_deg, 0});
      EXPECT_LE((grid.head<2>() - IgnLambert93(lat_deg, lon_deg)).norm(), kPublished_m)
          << lat_deg << " " << lon_deg;
    }
  }
}

TEST(Lambert93, ConvergenceIsTheConesAngle) {
  const MapFrame frame = *MapFrame::FromName("EPSG:2154");
  // Paris: 0.7256 of 0.665 degrees west of the central meridian.
  const double paris_deg = frame.ConvergenceRad({48.8366, 2.335, 35}) / kRadPerDeg;
  EXPECT_NEAR(paris_deg, -0.4825, 1e-4);
  for (const double lon_deg : {-5.0, 0.0, 3.0, 9.0}) {
    EXPECT_NEAR(frame.ConvergenceRad({45, lon_deg, 0}) / kRadPerDeg, kN * (lon_deg - 3), 1e-8);
  }
}

TEST(Lambert93, ScaleIsOneOnItsParallelsAndBelowBetween) {
  const MapFrame frame = *MapFrame::FromName("EPSG:2154");
  EXPECT_NEAR(frame.PointScale({44, 5, 0}), 1, 1e-12);
  EXPECT_NEAR(frame.PointScale({49, -2, 0}), 1, 1e-12);
  EXPECT_NEAR(frame.PointScale({46.5, 3, 0}), 0.999051, 1e-6);  // -95 cm a km, as published
  EXPECT_GT(frame.PointScale({51, 3, 0}), 1.0);
}

}  // namespace
}  // namespace panofix
