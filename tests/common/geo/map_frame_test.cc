#include "common/geo/map_frame.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "common/base/rng.h"
#include "common/geometry/attitude.h"

namespace panofix {
namespace {

// The contract of INTERFACES: WGS84 -> map -> WGS84 closes to this.
constexpr double kRoundTrip_deg = 1e-9;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// WGS84 radii of curvature, metres.
struct Radii {
  double meridian_m, prime_vertical_m;
};
Radii RadiiAt(double lat_deg) {
  constexpr double kA_m = 6378137.0, kF = 1 / 298.257223563, kE2 = kF * (2 - kF);
  const double s = std::sin(lat_deg * kRadPerDeg), w2 = 1 - kE2 * s * s;
  return {kA_m * (1 - kE2) / std::pow(w2, 1.5), kA_m / std::sqrt(w2)};
}

std::vector<MapFrame> Frames() {
  std::vector<MapFrame> frames{*MapFrame::FromName("EPSG:2154")};
  for (const double lat_deg :
       {-89.5, -75.0, -45.0, -10.0, -1.0, 0.0, 0.5, 9.0, 30.0, 48.85, 66.0, 80.0, 89.9}) {
    frames.push_back(MapFrame::Tangent({lat_deg, 2.335, 35}));
    frames.push_back(MapFrame::Tangent({lat_deg, 179.99, 0}));
  }
  return frames;
}

// Points around a frame's origin, up to 30 km off.
std::vector<Geodetic> PointsAround(const MapFrame& frame, Rng* rng) {
  std::vector<Geodetic> points;
  const LambertParameters& p = frame.parameters();
  for (int i = 0; i < 20; ++i) {
    const double lat_deg = std::clamp(p.lat0_deg + rng->Uniform(-0.3, 0.3), -89.95, 89.95);
    double lon_deg = p.lon0_deg + rng->Uniform(-0.3, 0.3);
    if (lon_deg >= 180) lon_deg -= 360;
    points.push_back({lat_deg, lon_deg, rng->Uniform(-50, 3000)});
  }
  return points;
}

TEST(MapFrame, RoundTripClosesAtManyLatitudes) {
  Rng rng(1, "tests/round_trip");
  for (const MapFrame& frame : Frames()) {
    for (const Geodetic& point : PointsAround(frame, &rng)) {
      const Geodetic back = frame.ToGeodetic(frame.ToMap(point));
      EXPECT_NEAR(back.lat_deg, point.lat_deg, kRoundTrip_deg);
      EXPECT_NEAR(AngleDifferenceDeg(back.lon_deg, point.lon_deg), 0, kRoundTrip_deg)
          << point.lat_deg;
      EXPECT_EQ(back.height_m, point.height_m);
    }
  }
}

TEST(MapFrame, Lambert93RoundTripClosesOverFrance) {
  Rng rng(1, "tests/france");
  const MapFrame frame = *MapFrame::FromName("lambert93");
  for (int i = 0; i < 500; ++i) {
    const Geodetic point{rng.Uniform(41, 51.5), rng.Uniform(-6, 10), 50};
    const Geodetic back = frame.ToGeodetic(frame.ToMap(point));
    EXPECT_NEAR(back.lat_deg, point.lat_deg, kRoundTrip_deg);
    EXPECT_NEAR(back.lon_deg, point.lon_deg, kRoundTrip_deg);
  }
}

TEST(MapFrame, TangentOriginIsTheOrigin) {
  for (const double lat_deg : {-60.0, 12.0, 48.85}) {
    const Geodetic origin{lat_deg, 2.335, 35};
    const MapFrame frame = MapFrame::Tangent(origin);
    EXPECT_LE((frame.ToMap(origin) - Eigen::Vector3d(0, 0, 35)).norm(), 1e-9);
    EXPECT_NEAR(frame.PointScale(origin), 1, 1e-12);
    EXPECT_NEAR(frame.ConvergenceRad(origin), 0, 1e-15);
  }
}

// True north on the grid, by central differences along the meridian, lies at bearing -convergence.
TEST(MapFrame, ConvergenceAgreesWithFiniteDifferences) {
  Rng rng(1, "tests/convergence");
  constexpr double kStep_deg = 1e-5;  // about a metre
  constexpr double kTol_rad = 1e-8;   // of coordinates rounded to 1e-9 m over 2 m
  for (const MapFrame& frame : Frames()) {
    for (const Geodetic& p : PointsAround(frame, &rng)) {
      const Eigen::Vector3d north = frame.ToMap({p.lat_deg + kStep_deg, p.lon_deg, 0}) -
                                    frame.ToMap({p.lat_deg - kStep_deg, p.lon_deg, 0});
      EXPECT_NEAR(std::atan2(north.x(), north.y()), -frame.ConvergenceRad(p), kTol_rad)
          << p.lat_deg;
      const Eigen::Vector3d north_in_map = frame.MapFromEnu(p) * Eigen::Vector3d::UnitY();
      EXPECT_LE((north_in_map - north.normalized()).norm(), kTol_rad);
    }
  }
}

// Conformal: the same scale along the meridian and along the parallel.
TEST(MapFrame, PointScaleAgreesWithFiniteDifferences) {
  Rng rng(1, "tests/scale");
  constexpr double kStep_deg = 1e-4;
  constexpr double kTolerance = 1e-7;  // of the difference quotient over some 20 m
  for (const MapFrame& frame : Frames()) {
    if (std::abs(frame.parameters().lat0_deg) > 85) continue;  // parallels are too short there
    for (const Geodetic& p : PointsAround(frame, &rng)) {
      const Radii radii = RadiiAt(p.lat_deg);
      const auto along = [&](double d_lat_deg, double d_lon_deg) {
        return (frame.ToMap({p.lat_deg + d_lat_deg, p.lon_deg + d_lon_deg, 0}) -
                frame.ToMap({p.lat_deg - d_lat_deg, p.lon_deg - d_lon_deg, 0}))
            .norm();
      };
      const double ground_north_m = 2 * kStep_deg * kRadPerDeg * radii.meridian_m;
      const double ground_east_m =
          2 * kStep_deg * kRadPerDeg * radii.prime_vertical_m * std::cos(p.lat_deg * kRadPerDeg);
      EXPECT_NEAR(along(kStep_deg, 0) / ground_north_m, frame.PointScale(p), kTolerance);
      EXPECT_NEAR(along(0, kStep_deg) / ground_east_m, frame.PointScale(p), kTolerance);
    }
  }
}

TEST(MapFrame, TangentKeepsACityAtGroundScale) {
  const MapFrame frame = MapFrame::Tangent({48.85, 2.335, 0});
  // The scale grows with the square of the distance: 10 km give (10/6380)^2 / 2 = 1.2e-6.
  EXPECT_NEAR(frame.PointScale({48.94, 2.335, 0}), 1, 1.5e-6);
  EXPECT_GT(frame.PointScale({48.94, 2.335, 0}), 1.0);
}

TEST(MapFrame, UnknownNamesAreNotFound) {
  for (const char* name : {"", "EPSG:4326", "epsg:2154", "tangent"}) {
    EXPECT_EQ(MapFrame::FromName(name).status().code(), ErrorCode::kNotFound) << name;
  }
}

TEST(MapFrame, ParametersThatMakeNoConeAreRefused) {
  const LambertParameters good{49, 44, 46.5, 3, 1, 7e5, 66e5};
  EXPECT_NO_THROW((void)MapFrame(good));
  const auto refused = [&](double LambertParameters::*member, double value) {
    LambertParameters p = good;
    p.*member = value;
    EXPECT_THROW((void)MapFrame(p), std::invalid_argument) << value;
  };
  for (const auto member :
       {&LambertParameters::lat1_deg, &LambertParameters::lat2_deg, &LambertParameters::lat0_deg,
        &LambertParameters::lon0_deg, &LambertParameters::scale,
        &LambertParameters::false_easting_m, &LambertParameters::false_northing_m}) {
    refused(member, kNan);
    refused(member, std::numeric_limits<double>::infinity());
  }
  refused(&LambertParameters::scale, 0);
  refused(&LambertParameters::scale, -1);
  refused(&LambertParameters::lat1_deg, 91);
  refused(&LambertParameters::lat0_deg, 91);
  EXPECT_THROW((void)MapFrame::Tangent({kNan, 0, 0}), std::invalid_argument);
  EXPECT_THROW((void)MapFrame::Tangent({48, kNan, 0}), std::invalid_argument);
}

}  // namespace
}  // namespace panofix
