#include "common/estimate/correspondence.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "common/estimate/refine.h"
#include "tests/support/synthetic_pose.h"

namespace panofix {
namespace {

// Central differences with steps of 1e-6 leave about 1e-9 on values near one.
constexpr double kDifferenceTolerance = 1e-7;
constexpr double kStep = 1e-6;

TEST(BearingResidual, IsZeroAtTheTruth) {
  const SyntheticPose world = MakeSyntheticPose({}, 1);
  for (const Correspondence& match : world.matches) {
    Eigen::Vector2d residual;
    ASSERT_TRUE(BearingResidual(match, world.cam_from_map, &residual));
    EXPECT_LT(residual.norm(), 1e-12);
  }
}

TEST(BearingResidual, RefusesPointsBehindOrTooNear) {
  Correspondence match;
  Eigen::Vector2d residual;
  for (const double depth_m : {-5.0, 0.0, 0.0999}) {
    match.point_in_map = {0, 0, depth_m};
    EXPECT_FALSE(BearingResidual(match, Rigid3(), &residual)) << depth_m;
  }
  match.point_in_map = {0, 0, 0.11};
  EXPECT_TRUE(BearingResidual(match, Rigid3(), &residual));
}

TEST(BearingResidual, RefusesNumbersThatAreNotFinite) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double inf = std::numeric_limits<double>::infinity();
  Eigen::Vector2d residual;
  for (const double bad : {nan, inf}) {
    Correspondence match;
    match.point_in_map = {0, 0, 5};
    match.bearing_in_cam = {bad, 0};
    EXPECT_FALSE(BearingResidual(match, Rigid3(), &residual));
    match.bearing_in_cam = {0, 0};
    match.point_in_map = {0, bad, 5};
    EXPECT_FALSE(BearingResidual(match, Rigid3(), &residual));
    match.point_in_map = {0, 0, bad};
    EXPECT_FALSE(BearingResidual(match, Rigid3(), &residual));
  }
}

TEST(BearingJacobian, EqualsDifferences) {
  SyntheticPoseOptions options;
  options.pixel_sigma = 5;
  const SyntheticPose world = MakeSyntheticPose(options, 2);
  const Rigid3 map_from_cam = world.cam_from_map.Inverse();
  for (const Correspondence& match : world.matches) {
    const Eigen::Matrix<double, 2, 6> analytic = BearingJacobian(match, world.cam_from_map);
    for (Eigen::Index k = 0; k < 6; ++k) {
      Eigen::Vector2d ends[2];
      for (const int side : {0, 1}) {
        // Spelt out from refine.h's definition, not through the library's own perturbation.
        Eigen::Matrix<double, 6, 1> delta = Eigen::Matrix<double, 6, 1>::Zero();
        delta[k] = side == 0 ? -kStep : kStep;
        const Rigid3 moved(ExpSo3(delta.tail<3>()) * map_from_cam.rotation,
                           map_from_cam.translation + delta.head<3>());
        ASSERT_TRUE(BearingResidual(match, moved.Inverse(), &ends[side]));
      }
      const Eigen::Vector2d numeric = (ends[1] - ends[0]) / (2 * kStep);
      EXPECT_LT((numeric - analytic.col(k)).norm(), kDifferenceTolerance) << "column " << k;
    }
  }
}

TEST(ResidualCovariance, EqualsSampledScatter) {
  Rng rng(3, "tests/residual_covariance");
  Correspondence match;
  match.point_in_map = {1, -2, 12};
  match.range_sigma_in_map = {0.05, 0.1, 0.1};
  match.point_sigma_m = 0.04;
  match.keypoint_sigma = 0.002;
  const Rigid3 pose(ExpSo3({0.1, -0.2, 0.05}), Eigen::Vector3d(0.3, 0.1, -0.5));
  const Eigen::Matrix2d model = ResidualCovariance(match, pose);
  Eigen::Vector2d centre;
  ASSERT_TRUE(BearingResidual(match, pose, &centre));
  Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
  constexpr int kSamples = 40000;
  for (int i = 0; i < kSamples; ++i) {
    Correspondence noisy = match;
    noisy.point_in_map += match.range_sigma_in_map * rng.Normal();
    noisy.point_in_map += match.point_sigma_m * RandomNormal3(&rng);
    noisy.bearing_in_cam.x() += match.keypoint_sigma * rng.Normal();
    noisy.bearing_in_cam.y() += match.keypoint_sigma * rng.Normal();
    Eigen::Vector2d residual;
    ASSERT_TRUE(BearingResidual(noisy, pose, &residual));
    scatter += (residual - centre) * (residual - centre).transpose() / kSamples;
  }
  // Four standard errors of a variance from 40000 samples.
  EXPECT_LT((scatter - model).norm(), 0.03 * model.norm());
}

TEST(ResidualCovariance, StaysPositiveForZeroSigmasAndPointsBehind) {
  Correspondence match;
  match.keypoint_sigma = 0;
  for (const double depth_m : {-3.0, 0.0, 8.0}) {
    match.point_in_map = {1, 1, depth_m};
    match.point_sigma_m = depth_m == 8.0 ? 0 : 0.1;
    const Eigen::Matrix2d covariance = ResidualCovariance(match, Rigid3());
    EXPECT_TRUE(covariance.allFinite());
    EXPECT_GT(covariance.determinant(), 0);
  }
}

}  // namespace
}  // namespace panofix
