#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <numeric>
#include <stdexcept>

#include "common/estimate/pnp.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_pose.h"

namespace panofix {
namespace {

// Least squares on exact matches; what is left is rounding.
constexpr double kExact_rad = 1e-7;
constexpr double kExact_m = 1e-6;

SyntheticPoseOptions Noisy(int num_matches, double outlier_share) {
  SyntheticPoseOptions options;
  options.num_matches = num_matches;
  options.outlier_share = outlier_share;
  options.pixel_sigma = 0.7;
  return options;
}

// Share of seeds whose pose is within 0.25 m and 2 degrees.
double SuccessRate(const SyntheticPoseOptions& world_options, RansacOptions options,
                   int num_seeds) {
  int good = 0;
  for (int seed = 0; seed < num_seeds; ++seed) {
    const SyntheticPose world = MakeSyntheticPose(world_options, static_cast<std::uint64_t>(seed));
    options.seed = static_cast<std::uint64_t>(seed);
    const RansacResult result = EstimatePoseRansac(world.matches, options);
    const auto near = Rigid3Near(world.cam_from_map.Inverse(), 0.035, 0.25);
    good += result.success && testing::Matches(near)(result.cam_from_map.Inverse());
  }
  return static_cast<double>(good) / num_seeds;
}

TEST(EstimatePoseRansac, CleanMatchesGiveTheTruthAndAllInliers) {
  const SyntheticPose world = MakeSyntheticPose({}, 1);
  const RansacResult result = EstimatePoseRansac(world.matches, {});
  ASSERT_TRUE(result.success);
  EXPECT_EQ(result.inliers.size(), world.matches.size());
  EXPECT_THAT(result.cam_from_map.Inverse(),
              Rigid3Near(world.cam_from_map.Inverse(), kExact_rad, kExact_m));
}

TEST(EstimatePoseRansac, SurvivesOutliers) {
  for (const double outlier_share : {0.2, 0.5, 0.7, 0.8}) {
    EXPECT_GE(SuccessRate(Noisy(300, outlier_share), {}, 100), 0.99) << outlier_share;
  }
}

TEST(EstimatePoseRansac, SurvivesNinetyPercentOutliersWithMoreTime) {
  RansacOptions options;
  options.max_iterations = 12000;
  EXPECT_GE(SuccessRate(Noisy(300, 0.9), options, 40), 0.95);
}

TEST(EstimatePoseRansac, EpnpSamplesSurviveHalfOutliers) {
  RansacOptions options;
  options.minimal_solver = MinimalSolver::kEpnp;
  EXPECT_GE(SuccessRate(Noisy(200, 0.5), options, 20), 0.95);
}

TEST(EstimatePoseRansac, LocalOptimizationFindsMoreInliers) {
  std::size_t plain = 0, optimized = 0;
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    const SyntheticPose world = MakeSyntheticPose(Noisy(200, 0.5), seed);
    RansacOptions options;
    options.seed = seed;
    optimized += EstimatePoseRansac(world.matches, options).inliers.size();
    options.local_optimizations = 0;
    plain += EstimatePoseRansac(world.matches, options).inliers.size();
  }
  EXPECT_GT(optimized, plain);
}

TEST(EstimatePoseRansac, FewMatchesManyOutliers) {
  // 12 of 40: what a thin frame offers.
  EXPECT_GE(SuccessRate(Noisy(40, 0.6), {}, 100), 0.9);
}

TEST(EstimatePoseRansac, PointsOnOnePlaneSuffice) {
  SyntheticPoseOptions options = Noisy(200, 0.5);
  options.layout = PointLayout::kPlane;
  EXPECT_GE(SuccessRate(options, {}, 100), 0.98);
}

TEST(EstimatePoseRansac, SameSeedSameResult) {
  const SyntheticPose world = MakeSyntheticPose(Noisy(150, 0.6), 4);
  const RansacResult a = EstimatePoseRansac(world.matches, {});
  const RansacResult b = EstimatePoseRansac(world.matches, {});
  EXPECT_EQ(a.inliers, b.inliers);
  EXPECT_EQ(a.iterations, b.iterations);
  EXPECT_EQ(a.cam_from_map.rotation.coeffs(), b.cam_from_map.rotation.coeffs());
  EXPECT_EQ(a.cam_from_map.translation, b.cam_from_map.translation);
}

TEST(EstimatePoseRansac, OrderOfMatchesDoesNotMatter) {
  SyntheticPoseOptions world_options;
  world_options.outlier_share = 0.4;
  const SyntheticPose world = MakeSyntheticPose(world_options, 5);
  const RansacResult straight = EstimatePoseRansac(world.matches, {});
  std::vector<Correspondence> reversed(world.matches.rbegin(), world.matches.rend());
  RansacResult turned = EstimatePoseRansac(reversed, {});
  const int last = static_cast<int>(world.matches.size()) - 1;
  for (int& index : turned.inliers) index = last - index;
  std::reverse(turned.inliers.begin(), turned.inliers.end());
  EXPECT_EQ(straight.inliers, turned.inliers);
  EXPECT_TRUE(std::is_sorted(turned.inliers.begin(), turned.inliers.end()));
}

TEST(EstimatePoseRansac, FarFromTheOriginLosesNothing) {
  SyntheticPose world = MakeSyntheticPose(Noisy(200, 0.3), 6);
  const RansacResult here = EstimatePoseRansac(world.matches, {});
  const Eigen::Vector3d far(650000, 6860000, 35);  // Lambert-93 coordinates
  for (Correspondence& match : world.matches) match.point_in_map += far;
  const RansacResult there = EstimatePoseRansac(world.matches, {});
  ASSERT_TRUE(here.success && there.success);
  EXPECT_EQ(here.inliers, there.inliers);
  EXPECT_LT(
      (there.cam_from_map.Inverse().translation - far - here.cam_from_map.Inverse().translation)
          .norm(),
      1e-5);
}

TEST(EstimatePoseRansac, PointsOnALineHaveNoPose) {
  SyntheticPoseOptions world_options;
  world_options.layout = PointLayout::kLine;
  EXPECT_FALSE(EstimatePoseRansac(MakeSyntheticPose(world_options, 7).matches, {}).success);
}

TEST(EstimatePoseRansac, TooFewMatchesHaveNoPose) {
  const SyntheticPose world = MakeSyntheticPose({}, 8);
  for (std::size_t count = 0; count < 4; ++count) {
    for (const MinimalSolver solver : {MinimalSolver::kP3p, MinimalSolver::kEpnp}) {
      RansacOptions options;
      options.minimal_solver = solver;
      const RansacResult result =
          EstimatePoseRansac(std::span(world.matches).first(count), options);
      EXPECT_FALSE(result.success);
      EXPECT_TRUE(result.inliers.empty());
    }
  }
}

TEST(EstimatePoseRansac, IdenticalMatchesHaveNoPose) {
  const SyntheticPose world = MakeSyntheticPose({}, 9);
  const std::vector<Correspondence> same(50, world.matches[0]);
  EXPECT_FALSE(EstimatePoseRansac(same, {}).success);
}

TEST(EstimatePoseRansac, PureOutliersReachNoConsensus) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const SyntheticPose world = MakeSyntheticPose(Noisy(100, 1.0), seed);
    RansacOptions options;
    options.min_inliers = 14;  // chance finds about 10 of 100 within 3 px
    EXPECT_FALSE(EstimatePoseRansac(world.matches, options).success) << seed;
  }
}

TEST(EstimatePoseRansac, PointsBehindTheCameraAreNeverInliers) {
  SyntheticPose world = MakeSyntheticPose({}, 10);
  const Rigid3 map_from_cam = world.cam_from_map.Inverse();
  // The mirror images through the camera's centre have the same bearings.
  for (std::size_t i = 0; i < 60; ++i) {
    world.matches[i].point_in_map = 2 * map_from_cam.translation - world.matches[i].point_in_map;
  }
  const RansacResult result = EstimatePoseRansac(world.matches, {});
  ASSERT_TRUE(result.success);
  ASSERT_EQ(result.inliers.size(), world.matches.size() - 60);
  EXPECT_EQ(result.inliers.front(), 60);
}

TEST(EstimatePoseRansac, HostileNumbersAreNeverInliers) {
  SyntheticPose world = MakeSyntheticPose({}, 11);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double inf = std::numeric_limits<double>::infinity();
  const double largest = std::numeric_limits<double>::max();
  const std::array<double, 5> bad = {nan, inf, -inf, largest, 1e30};
  for (std::size_t i = 0; i < 50; ++i) {
    if (i % 2 == 0) {
      world.matches[i].point_in_map[static_cast<Eigen::Index>(i % 3)] = bad[i % 5];
    } else {
      world.matches[i].bearing_in_cam[static_cast<Eigen::Index>(i % 2)] = bad[i % 5];
    }
  }
  for (const MinimalSolver solver : {MinimalSolver::kP3p, MinimalSolver::kEpnp}) {
    RansacOptions options;
    options.minimal_solver = solver;
    const RansacResult result = EstimatePoseRansac(world.matches, options);
    ASSERT_TRUE(result.success);
    ASSERT_EQ(result.inliers.size(), world.matches.size() - 50);
    EXPECT_EQ(result.inliers.front(), 50);
  }
  for (Correspondence& match : world.matches) match.point_in_map.setConstant(nan);
  EXPECT_FALSE(EstimatePoseRansac(world.matches, {}).success);
}

// Two thirds of the matches speak for one pose, a third for another.
struct TwoPoses {
  Rigid3 many, few;  // cam_from_map
  std::vector<Correspondence> matches;
};
TwoPoses MakeTwoPoses(const Rigid3& many_from_few) {
  const SyntheticPose world = MakeSyntheticPose(Noisy(120, 0), 3);
  TwoPoses result{many_from_few * world.cam_from_map, world.cam_from_map, world.matches};
  for (std::size_t i = 0; i < result.matches.size(); ++i) {
    const Eigen::Vector3d x = result.many * result.matches[i].point_in_map;
    if (i % 3 != 0 && x.z() > 0.1) result.matches[i].bearing_in_cam = x.head<2>() / x.z();
  }
  return result;
}
// The better supported pose without bounds, the other one within.
void ExpectBoundsToDecide(const TwoPoses& world, const PoseBounds& bounds) {
  RansacOptions options;
  const auto is_at = [](const Rigid3& pose) { return Rigid3Near(pose.Inverse(), 0.035, 0.25); };
  EXPECT_THAT(EstimatePoseRansac(world.matches, options).cam_from_map.Inverse(), is_at(world.many));
  options.bounds = bounds;
  const RansacResult bounded = EstimatePoseRansac(world.matches, options);
  EXPECT_TRUE(bounded.success);
  EXPECT_THAT(bounded.cam_from_map.Inverse(), is_at(world.few));
}

constexpr double kAny = 1e9;

TEST(EstimatePoseRansac, DistanceIsBounded) {
  const TwoPoses world = MakeTwoPoses(Rigid3(Eigen::Quaterniond::Identity(), {3, -3, 3}));
  Rigid3 rough = world.few;
  rough.translation.x() += 0.5;
  ExpectBoundsToDecide(world, {rough, 1.5, kAny, kAny});
}

TEST(EstimatePoseRansac, HeightIsBounded) {
  const TwoPoses world = MakeTwoPoses(Rigid3(
      Eigen::Quaterniond::Identity(),
      -4 * (MakeSyntheticPose(Noisy(120, 0), 3).cam_from_map.rotation * Eigen::Vector3d::UnitZ())));
  ExpectBoundsToDecide(world, {world.few, kAny, 2, kAny});
}

TEST(EstimatePoseRansac, TiltIsBounded) {
  const Eigen::Quaterniond rolled(Eigen::AngleAxisd(0.6, Eigen::Vector3d::UnitZ()));
  const TwoPoses world = MakeTwoPoses(Rigid3(rolled, Eigen::Vector3d::Zero()));
  ExpectBoundsToDecide(world, {world.few, kAny, kAny, 0.3});
}

TEST(RansacOptions, CheckNamesFieldValueAndRule) {
  RansacOptions options;
  EXPECT_NO_THROW(options.Check());
  options.success_probability = 1.5;
  try {
    options.Check();
    FAIL() << "1.5 was accepted";
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(),
                testing::AllOf(testing::HasSubstr("success_probability"), testing::HasSubstr("1.5"),
                               testing::HasSubstr("(0, 1)")));
  }
}

TEST(RansacOptions, CheckRefusesEachBrokenField) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto broken = [](auto change) {
    RansacOptions options;
    change(&options);
    EXPECT_THROW(options.Check(), std::invalid_argument);
  };
  broken([](RansacOptions* o) { o->max_reproj_error_px = 0; });
  broken([nan](RansacOptions* o) { o->max_reproj_error_px = nan; });
  broken([](RansacOptions* o) { o->focal_px = -1; });
  broken([](RansacOptions* o) { o->min_iterations = 0; });
  broken([](RansacOptions* o) { o->max_iterations = 10; });
  broken([nan](RansacOptions* o) { o->success_probability = nan; });
  broken([](RansacOptions* o) { o->min_inliers = 3; });
  broken([](RansacOptions* o) { o->local_optimizations = -1; });
}

}  // namespace
}  // namespace panofix
