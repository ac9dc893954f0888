#include "common/estimate/focal_check.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/support/synthetic_pose.h"

namespace panofix {
namespace {

constexpr double kTukey_t = 4.6851;

// What a camera with another focal length than stated would have measured.
std::vector<Correspondence> WithFocalError(std::vector<Correspondence> matches, double error) {
  for (Correspondence& match : matches) match.bearing_in_cam *= 1 + error;
  return matches;
}

// The pose that a program would find: refined with the wrong focal length.
FocalCheck CheckAfterRefinement(const SyntheticPose& scene,
                                const std::vector<Correspondence>& matches) {
  const RefineResult refined = RefinePose(matches, scene.cam_from_map, {});
  EXPECT_TRUE(refined.success);
  return CheckFocal(matches, refined.cam_from_map, kTukey_t);
}

SyntheticPose NoisyScene(std::uint64_t seed) {
  SyntheticPoseOptions options;
  options.pixel_sigma = 1;
  options.range_sigma_share = 0.02;
  return MakeSyntheticPose(options, seed);
}

TEST(CheckFocal, MeasuresAWrongFocalLength) {
  for (const double error : {-0.05, -0.02, 0.02, 0.05}) {
    double sum = 0;
    constexpr int kTrials = 20;
    for (std::uint64_t seed = 1; seed <= kTrials; ++seed) {
      const SyntheticPose scene = NoisyScene(seed);
      sum += CheckAfterRefinement(scene, WithFocalError(scene.matches, error)).error / kTrials;
    }
    // One Gauss-Newton step from a pose that has taken up a part of it.
    EXPECT_NEAR(sum, error, 0.35 * std::abs(error)) << error;
  }
}

TEST(CheckFocal, IsCalibratedWhereTheFocalLengthIsRight) {
  double sum_sq = 0;
  constexpr int kTrials = 100;
  for (std::uint64_t seed = 1; seed <= kTrials; ++seed) {
    const SyntheticPose scene = NoisyScene(seed);
    const FocalCheck check = CheckAfterRefinement(scene, scene.matches);
    sum_sq += check.error * check.error / (check.sigma * check.sigma * kTrials);
  }
  // Mean square of 100 normal deviates: 1 within 0.14, 1 sigma.
  EXPECT_GT(sum_sq, 0.55);
  EXPECT_LT(sum_sq, 1.6);
}

TEST(CheckFocal, OnePlaneSquareOnSaysNothing) {
  // Nearer and longer look alike.
  std::vector<Correspondence> matches;
  for (int x = -3; x <= 3; ++x) {
    for (int y = -2; y <= 2; ++y) {
      Correspondence match;
      match.point_in_map = {double(x), double(y), 10};
      match.bearing_in_cam = {0.1 * x, 0.1 * y};
      matches.push_back(match);
    }
  }
  EXPECT_GT(CheckFocal(matches, Rigid3(), kTukey_t).sigma, 0.5);
}

TEST(CheckFocal, TooFewOrHostileMatchesSayNothing) {
  EXPECT_GT(CheckFocal({}, Rigid3(), kTukey_t).sigma, 1e6);
  std::vector<Correspondence> matches(20);  // all at the camera's centre
  EXPECT_GT(CheckFocal(matches, Rigid3(), kTukey_t).sigma, 1e6);
  SyntheticPose scene = NoisyScene(1);
  for (Correspondence& match : scene.matches) match.point_in_map.x() = std::nan("");
  EXPECT_GT(CheckFocal(scene.matches, scene.cam_from_map, kTukey_t).sigma, 1e6);
}

}  // namespace
}  // namespace panofix
