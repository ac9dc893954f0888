#include "common/estimate/refine.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "common/estimate/pnp.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_pose.h"

namespace panofix {
namespace {

constexpr double kExact_rad = 1e-8;
constexpr double kExact_m = 1e-7;

// The truth, moved as far as RANSAC leaves it: a few centimetres and tenths of a degree.
Rigid3 Nearby(const Rigid3& cam_from_map, std::uint64_t seed) {
  Rng rng(seed, "tests/nearby");
  const Rigid3 map_from_cam = cam_from_map.Inverse();
  const Eigen::Vector3d shift = 0.02 * RandomNormal3(&rng), turn = 0.002 * RandomNormal3(&rng);
  return Rigid3(ExpSo3(turn) * map_from_cam.rotation, map_from_cam.translation + shift).Inverse();
}

double Median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double PositionError_m(const Rigid3& estimated, const Rigid3& truth) {
  return PoseError(estimated, truth).head<3>().norm();
}

TEST(TukeyRho, FollowsEquation6) {
  const double t = 4.6851;
  EXPECT_EQ(TukeyRho(0, t), 0);
  EXPECT_DOUBLE_EQ(TukeyRho(t, t), t * t / 6);
  EXPECT_DOUBLE_EQ(TukeyRho(100, t), t * t / 6);
  EXPECT_DOUBLE_EQ(TukeyRho(-2, t), TukeyRho(2, t));
  EXPECT_NEAR(TukeyRho(2, 4), 16.0 / 6 * (1 - 27.0 / 64), 1e-15);
  EXPECT_NEAR(TukeyRho(1e-3, t), 0.5e-6, 1e-12);  // least squares near zero
}

TEST(TukeyWeight, IsTheDerivativeOverX) {
  constexpr double kStep = 1e-5;
  const double t = 4.6851;
  for (double x = -6; x <= 6; x += 0.37) {
    const double slope = (TukeyRho(x + kStep, t) - TukeyRho(x - kStep, t)) / (2 * kStep);
    EXPECT_NEAR(TukeyWeight(x, t), slope / x, 1e-8) << x;
  }
  EXPECT_EQ(TukeyWeight(0, t), 1);
}

TEST(TukeyWeight, OddArgumentsWeighNothing) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(TukeyWeight(nan, 4), 0);
  EXPECT_EQ(TukeyWeight(1, nan), 0);
  EXPECT_EQ(TukeyWeight(0, 0), 0);
  EXPECT_EQ(TukeyWeight(std::numeric_limits<double>::infinity(), 4), 0);
}

TEST(RefinePose, CleanMatchesGiveTheTruth) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const SyntheticPose world = MakeSyntheticPose({}, seed);
    const RefineResult result = RefinePose(world.matches, Nearby(world.cam_from_map, seed), {});
    ASSERT_TRUE(result.success);
    EXPECT_THAT(result.cam_from_map.Inverse(),
                Rigid3Near(world.cam_from_map.Inverse(), kExact_rad, kExact_m));
    EXPECT_EQ(result.num_inliers, static_cast<int>(world.matches.size()));
  }
}

TEST(RefinePose, AnnealingReachesFromFarther) {
  SyntheticPoseOptions options;
  options.pixel_sigma = 1;
  const SyntheticPose world = MakeSyntheticPose(options, 3);
  const Rigid3 map_from_cam = world.cam_from_map.Inverse();
  // About 20 sigmas at the median point.
  const Rigid3 start = Rigid3(ExpSo3({0, 0, 0.02}) * map_from_cam.rotation,
                              map_from_cam.translation + Eigen::Vector3d(0.1, -0.1, 0.05))
                           .Inverse();
  const RefineResult annealed = RefinePose(world.matches, start, {});
  ASSERT_TRUE(annealed.success);
  EXPECT_THAT(annealed.cam_from_map.Inverse(), Rigid3Near(map_from_cam, 0.002, 0.03));
  EXPECT_GT(annealed.num_inliers, 190);
}

TEST(RefinePose, OutliersWeighNothing) {
  SyntheticPoseOptions options;
  options.outlier_share = 0.3;
  options.pixel_sigma = 0.5;
  const SyntheticPose world = MakeSyntheticPose(options, 4);
  const RefineResult result = RefinePose(world.matches, Nearby(world.cam_from_map, 4), {});
  ASSERT_TRUE(result.success);
  EXPECT_LT(PositionError_m(result.cam_from_map, world.cam_from_map), 0.02);
  int outliers_used = 0;
  for (std::size_t i = 0; i < world.matches.size(); ++i) {
    EXPECT_GE(result.weights[i], 0);
    EXPECT_LE(result.weights[i], 1);
    outliers_used += world.is_outlier[i] && result.weights[i] > 0;
  }
  EXPECT_LE(outliers_used, 2);
}

TEST(RefinePose, FarPointsWithRangeNoiseDoNotRuinTheTranslation) {
  // The paper's failure: plane depth that is 10 % off, most matches far down the street.
  std::vector<double> with_sigma, without_sigma;
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    SyntheticPoseOptions options;
    options.min_depth_m = 6, options.max_depth_m = 80;
    options.range_sigma_share = 0.1;
    options.pixel_sigma = 0.7;
    const SyntheticPose world = MakeSyntheticPose(options, seed);
    const Rigid3 start = Nearby(world.cam_from_map, seed);
    RefineOptions refine;
    const RefineResult with = RefinePose(world.matches, start, refine);
    refine.use_point_sigma = false;
    const RefineResult without = RefinePose(world.matches, start, refine);
    ASSERT_TRUE(with.success);
    with_sigma.push_back(PositionError_m(with.cam_from_map, world.cam_from_map));
    without_sigma.push_back(PositionError_m(without.cam_from_map, world.cam_from_map));
  }
  EXPECT_LT(Median(with_sigma), 0.5 * Median(without_sigma));
}

TEST(RefinePose, GravityPriorHoldsRollAndPitch) {
  SyntheticPoseOptions options;
  options.num_matches = 8;
  options.pixel_sigma = 2;
  std::vector<double> with_prior, without_prior;
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    const SyntheticPose world = MakeSyntheticPose(options, seed);
    RefineOptions refine;
    const Rigid3 start = Nearby(world.cam_from_map, seed);
    const RefineResult without = RefinePose(world.matches, start, refine);
    refine.gravity_sigma_rad = 1e-4;
    refine.up_in_cam = world.cam_from_map.rotation * Eigen::Vector3d::UnitZ();
    const RefineResult with = RefinePose(world.matches, start, refine);
    if (!with.success || !without.success) continue;
    with_prior.push_back(PoseError(with.cam_from_map, world.cam_from_map).segment<2>(3).norm());
    without_prior.push_back(
        PoseError(without.cam_from_map, world.cam_from_map).segment<2>(3).norm());
    EXPECT_LT(with.covariance(3, 3), without.covariance(3, 3));
  }
  ASSERT_GT(with_prior.size(), 40U);
  EXPECT_LT(Median(with_prior), 3e-4);
  EXPECT_GT(Median(without_prior), 1e-3);
}

TEST(RefinePose, ChiSquareIsOneWhereTheModelHolds) {
  std::vector<double> values;
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    SyntheticPoseOptions options;
    options.pixel_sigma = 0.8;
    options.point_sigma_m = 0.03;
    const SyntheticPose world = MakeSyntheticPose(options, seed);
    values.push_back(RefinePose(world.matches, Nearby(world.cam_from_map, seed), {}).chi2_per_dof);
  }
  EXPECT_NEAR(Median(values), 1.0, 0.05);
}

TEST(RefinePose, UnderstatedNoiseWidensTheCovariance) {
  SyntheticPoseOptions options;
  options.pixel_sigma = 1;
  const SyntheticPose world = MakeSyntheticPose(options, 5);
  std::vector<Correspondence> confident = world.matches;
  for (Correspondence& match : confident) match.keypoint_sigma /= 1.5;
  const Rigid3 start = Nearby(world.cam_from_map, 5);
  const RefineResult honest = RefinePose(world.matches, start, {});
  const RefineResult repaired = RefinePose(confident, start, {});
  EXPECT_GT(repaired.chi2_per_dof, 1.5);
  EXPECT_GT(repaired.covariance(0, 0), 0.7 * honest.covariance(0, 0));
}

TEST(RefinePose, PlaneIsEnoughLineIsNot) {
  SyntheticPoseOptions options;
  options.layout = PointLayout::kPlane;
  SyntheticPose world = MakeSyntheticPose(options, 6);
  const RefineResult plane = RefinePose(world.matches, Nearby(world.cam_from_map, 6), {});
  ASSERT_TRUE(plane.success);
  EXPECT_LT(PositionError_m(plane.cam_from_map, world.cam_from_map), 1e-6);

  options.layout = PointLayout::kLine;
  world = MakeSyntheticPose(options, 6);
  const RefineResult line = RefinePose(world.matches, Nearby(world.cam_from_map, 6), {});
  // Either no pose, or one that says it does not know where it is.
  EXPECT_TRUE(!line.success || line.covariance.diagonal().head(3).sum() > 1);
}

TEST(RefinePose, TooFewOrIdenticalMatchesFail) {
  const SyntheticPose world = MakeSyntheticPose({}, 7);
  for (std::size_t count = 0; count < 4; ++count) {
    const RefineResult result =
        RefinePose(std::span(world.matches).first(count), world.cam_from_map, {});
    EXPECT_FALSE(result.success);
    EXPECT_EQ(result.weights.size(), count);
  }
  const std::vector<Correspondence> same(20, world.matches[0]);
  EXPECT_FALSE(RefinePose(same, world.cam_from_map, {}).success);
}

TEST(RefinePose, AllPointsBehindFail) {
  const SyntheticPose world = MakeSyntheticPose({}, 8);
  const Rigid3 map_from_cam = world.cam_from_map.Inverse();
  const Eigen::Quaterniond half_turn(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitZ()));
  const Rigid3 turned(half_turn * map_from_cam.rotation, map_from_cam.translation);
  const RefineResult result = RefinePose(world.matches, turned.Inverse(), {});
  EXPECT_FALSE(result.success);
  EXPECT_EQ(result.num_inliers, 0);
}

TEST(RefinePose, HostileNumbersWeighNothing) {
  SyntheticPose world = MakeSyntheticPose({}, 9);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  world.matches[0].bearing_in_cam.x() = nan;
  world.matches[1].point_in_map.y() = std::numeric_limits<double>::infinity();
  world.matches[2].range_sigma_in_map.z() = nan;
  world.matches[3].point_sigma_m = nan;
  world.matches[4].keypoint_sigma = nan;
  world.matches[5].point_in_map.x() = std::numeric_limits<double>::max();
  world.matches[6].range_sigma_in_map.setConstant(1e200);
  const RefineResult result = RefinePose(world.matches, Nearby(world.cam_from_map, 9), {});
  ASSERT_TRUE(result.success);
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(result.weights[i], 0) << i;
  EXPECT_LT(PositionError_m(result.cam_from_map, world.cam_from_map), 1e-5);
  Rigid3 broken;
  broken.translation.x() = nan;
  EXPECT_FALSE(RefinePose(world.matches, broken, {}).success);
}

}  // namespace
}  // namespace panofix
