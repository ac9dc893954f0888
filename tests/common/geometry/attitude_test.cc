#include "common/geometry/attitude.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>

#include "common/base/rng.h"
#include "common/geo/map_frame.h"

namespace panofix {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kRounding = 1e-14;
// The contract of INTERFACES for attitude round trips.
constexpr double kRoundTrip_deg = 1e-9;

void ExpectSameAttitude(const Attitude& actual, const Attitude& expected, double tolerance_deg) {
  const auto off = [](double a, double b) { return std::abs(AngleDifferenceDeg(a, b)); };
  EXPECT_LE(off(actual.heading_deg, expected.heading_deg), tolerance_deg) << expected.heading_deg;
  EXPECT_LE(off(actual.pitch_deg, expected.pitch_deg), tolerance_deg) << expected.pitch_deg;
  EXPECT_LE(off(actual.roll_deg, expected.roll_deg), tolerance_deg) << expected.roll_deg;
}

TEST(EnuFromBody, LevelAndNorthIsTheIdentity) {
  EXPECT_LE((EnuFromBody({0, 0, 0}) - Matrix3d::Identity()).norm(), kRounding);
}

TEST(EnuFromBody, HeadingTurnsClockwiseFromNorth) {
  const Matrix3d east = EnuFromBody({90, 0, 0});
  EXPECT_LE((east.col(1) - Vector3d::UnitX()).norm(), kRounding);  // forward is east
  EXPECT_LE((east.col(0) + Vector3d::UnitY()).norm(), kRounding);  // right is south
  EXPECT_LE((east.col(2) - Vector3d::UnitZ()).norm(), kRounding);
}

TEST(EnuFromBody, PitchLooksUpAndRollDropsTheRightSide) {
  EXPECT_NEAR(EnuFromBody({0, 30, 0}).col(1).z(), 0.5, kRounding);
  EXPECT_NEAR(EnuFromBody({0, 0, 30}).col(0).z(), -0.5, kRounding);
}

// The closed form of Rz(-heading) Rx(pitch) Ry(roll), multiplied out by hand.
TEST(EnuFromBody, FollowsTheClosedForm) {
  Rng rng(1, "tests/attitude");
  for (int i = 0; i < 1000; ++i) {
    const Attitude a{rng.Uniform(-360, 720), rng.Uniform(-90, 90), rng.Uniform(-180, 180)};
    const double sh = std::sin(a.heading_deg * kRadPerDeg),
                 ch = std::cos(a.heading_deg * kRadPerDeg);
    const double sp = std::sin(a.pitch_deg * kRadPerDeg), cp = std::cos(a.pitch_deg * kRadPerDeg);
    const double sr = std::sin(a.roll_deg * kRadPerDeg), cr = std::cos(a.roll_deg * kRadPerDeg);
    Matrix3d expected;
    expected << ch * cr + sh * sp * sr, sh * cp, ch * sr - sh * sp * cr,  //
        -sh * cr + ch * sp * sr, ch * cp, -sh * sr - ch * sp * cr,        //
        -cp * sr, sp, cp * cr;
    ASSERT_LE((EnuFromBody(a) - expected).norm(), kRounding);
  }
}

TEST(AttitudeFromEnu, RoundTripCloses) {
  Rng rng(1, "tests/round_trip");
  for (int i = 0; i < 2000; ++i) {
    const Attitude a{rng.Uniform(0, 360), rng.Uniform(-89.9, 89.9), rng.Uniform(-180, 180)};
    const Attitude back = AttitudeFromEnu(EnuFromBody(a));
    ExpectSameAttitude(back, a, kRoundTrip_deg);
    EXPECT_GE(back.heading_deg, 0.0);
    EXPECT_LT(back.heading_deg, 360.0);
  }
}

TEST(AttitudeFromEnu, RoundTripClosesThroughTheGridOfAMap) {
  Rng rng(1, "tests/grid");
  const MapFrame lambert93 = *MapFrame::FromName("EPSG:2154");
  for (int i = 0; i < 500; ++i) {
    const Geodetic point{rng.Uniform(42, 51), rng.Uniform(-5, 8), 100};
    const Attitude a{rng.Uniform(0, 360), rng.Uniform(-80, 80), rng.Uniform(-170, 170)};
    const Matrix3d map_from_body = lambert93.MapFromEnu(point) * EnuFromBody(a);
    // On the grid the body points along its heading less the convergence.
    const double grid_bearing_deg =
        std::atan2(map_from_body(0, 1), map_from_body(1, 1)) / kRadPerDeg;
    const double expected_deg = a.heading_deg - lambert93.ConvergenceRad(point) / kRadPerDeg;
    EXPECT_NEAR(AngleDifferenceDeg(grid_bearing_deg, expected_deg), 0, kRoundTrip_deg);
    const Matrix3d enu_from_body = lambert93.MapFromEnu(point).transpose() * map_from_body;
    ExpectSameAttitude(AttitudeFromEnu(enu_from_body), a, kRoundTrip_deg);
  }
}

// Straight up and down heading and roll turn about one axis; roll is then 0 and the rotation stays.
TEST(AttitudeFromEnu, GimbalLockKeepsTheRotation) {
  for (const double pitch_deg : {90.0, -90.0}) {
    for (const double heading_deg : {0.0, 77.0, 200.0}) {
      const Matrix3d R = EnuFromBody({heading_deg, pitch_deg, 25});
      const Attitude back = AttitudeFromEnu(R);
      EXPECT_NEAR(back.pitch_deg, pitch_deg, kRoundTrip_deg);
      EXPECT_EQ(back.roll_deg, 0.0);
      EXPECT_LE((EnuFromBody(back) - R).norm(), 1e-12);
    }
  }
}

TEST(AttitudeFromEnu, UpsideDownStaysInRange) {
  Matrix3d upside_down = Matrix3d::Identity();
  upside_down(0, 0) = upside_down(2, 2) = -1;
  for (const double zero : {0.0, -0.0}) {
    upside_down(2, 0) = zero;
    EXPECT_EQ(AttitudeFromEnu(upside_down).roll_deg, 180.0);
  }
  EXPECT_EQ(AttitudeFromEnu(EnuFromBody({0, 0, -180})).roll_deg, 180.0);
}

TEST(AttitudeFromEnu, HeadingNeverReaches360) {
  for (const double tiny_deg : {-1e-20, -1e-15, -1e-12, 0.0}) {
    const double heading_deg = AttitudeFromEnu(EnuFromBody({tiny_deg, 0, 0})).heading_deg;
    EXPECT_GE(heading_deg, 0.0);
    EXPECT_LT(heading_deg, 360.0);
  }
}

TEST(BodyFromCam, RightDownForwardBecomesRightForwardUp) {
  EXPECT_EQ(BodyFromCam() * Vector3d::UnitX(), Vector3d::UnitX());
  EXPECT_EQ(BodyFromCam() * Vector3d::UnitY(), Vector3d(-Vector3d::UnitZ()));
  EXPECT_EQ(BodyFromCam() * Vector3d::UnitZ(), Vector3d::UnitY());
  EXPECT_EQ(BodyFromCam().determinant(), 1.0);
}

TEST(AngleDifferenceDeg, TakesTheShortWay) {
  EXPECT_EQ(AngleDifferenceDeg(10, 350), 20.0);
  EXPECT_EQ(AngleDifferenceDeg(350, 10), -20.0);
  EXPECT_EQ(AngleDifferenceDeg(180, 0), -180.0);
  EXPECT_EQ(AngleDifferenceDeg(-180, 0), -180.0);
  EXPECT_EQ(AngleDifferenceDeg(1080, 0), 0.0);
  EXPECT_EQ(AngleDifferenceDeg(-725, 5), -10.0);
}

TEST(AngleDifferenceDeg, StaysInItsRange) {
  Rng rng(1, "tests/difference");
  const double just_below = std::nextafter(-180.0, -std::numeric_limits<double>::infinity());
  EXPECT_LT(AngleDifferenceDeg(just_below, 0), 180.0);
  for (int i = 0; i < 10000; ++i) {
    const double d = AngleDifferenceDeg(rng.Uniform(-1e4, 1e4), rng.Uniform(-1e4, 1e4));
    ASSERT_GE(d, -180.0);
    ASSERT_LT(d, 180.0);
  }
}

}  // namespace
}  // namespace panofix
