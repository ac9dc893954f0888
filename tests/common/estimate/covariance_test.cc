// Is the stated covariance the scatter that really happens? Noise is drawn from the stated model,
// and the normalised estimation error squared (NEES) must follow chi-square with six degrees of
// freedom.

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <vector>

#include "common/estimate/normal_equations.h"
#include "common/estimate/refine.h"
#include "tests/support/synthetic_pose.h"

namespace panofix {
namespace {

constexpr double kMedianChi2Of6 = 5.3481;
constexpr double kShare = 0.2;  // Tukey's weights alone shift the median by a tenth
constexpr int kTrials = 300;

double MedianNees(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double Nees(const Rigid3& estimated, const Rigid3& truth, const Matrix6d& covariance) {
  const Eigen::Matrix<double, 6, 1> error = PoseError(estimated, truth);
  return error.dot(covariance.ldlt().solve(error));
}

double RefineNees(const SyntheticPoseOptions& options) {
  std::vector<double> values;
  for (std::uint64_t seed = 0; seed < kTrials; ++seed) {
    const SyntheticPose world = MakeSyntheticPose(options, seed);
    const RefineResult result = RefinePose(world.matches, world.cam_from_map, {});
    EXPECT_TRUE(result.success) << seed;
    values.push_back(Nees(result.cam_from_map, world.cam_from_map, result.covariance));
  }
  return MedianNees(values);
}

TEST(RefineCovariance, IsCalibratedForPixelNoise) {
  SyntheticPoseOptions options;
  options.pixel_sigma = 1;
  EXPECT_NEAR(RefineNees(options), kMedianChi2Of6, kShare * kMedianChi2Of6);
}

TEST(RefineCovariance, IsCalibratedForRangeAndPointNoise) {
  SyntheticPoseOptions options;
  options.pixel_sigma = 0.7;
  options.range_sigma_share = 0.03;
  options.point_sigma_m = 0.02;
  EXPECT_NEAR(RefineNees(options), kMedianChi2Of6, kShare * kMedianChi2Of6);
}

TEST(RefineCovariance, IsCalibratedWithOutliers) {
  SyntheticPoseOptions options;
  options.pixel_sigma = 0.7;
  options.range_sigma_share = 0.02;
  options.outlier_share = 0.2;
  EXPECT_NEAR(RefineNees(options), kMedianChi2Of6, kShare * kMedianChi2Of6);
}

TEST(BundleCovariance, IsCalibratedForPanoramaErrors) {
  SyntheticPoseOptions options;
  options.num_matches = 120;
  options.pixel_sigma = 0.7;
  options.range_sigma_share = 0.02;
  options.point_sigma_m = 0.01;
  options.panorama_position_sigma_m = 0.08;
  options.panorama_heading_sigma_rad = 0.005;
  options.panorama_tilt_sigma_rad = 0.003;
  std::vector<double> values;
  for (std::uint64_t seed = 0; seed < kTrials; ++seed) {
    const SyntheticPose world = MakeSyntheticPose(options, seed);
    const BundleResult result =
        LocalBundleAdjustment(world.matches, world.cam_from_map, world.priors, {});
    ASSERT_TRUE(result.success) << seed;
    values.push_back(Nees(result.cam_from_map, world.cam_from_map, result.covariance));
  }
  EXPECT_NEAR(MedianNees(values), kMedianChi2Of6, kShare * kMedianChi2Of6);
}

TEST(InvertInformation, InvertsAndRefusesSingularMatrices) {
  Rng rng(1, "tests/information");
  Matrix6d root;
  for (Eigen::Index i = 0; i < 36; ++i) root(i / 6, i % 6) = rng.Normal();
  // Metres against radians: six orders of magnitude apart.
  const Eigen::Matrix<double, 6, 1> scale{1, 1, 1, 1e3, 1e3, 1e3};
  const Matrix6d information = scale.asDiagonal() * root.transpose() * root * scale.asDiagonal();
  const auto inverse = InvertInformation(information);
  ASSERT_TRUE(inverse.has_value());
  EXPECT_LT((*inverse * information - Matrix6d::Identity()).norm(), 1e-6);
  root.row(3) = root.row(2);
  EXPECT_FALSE(InvertInformation(root.transpose() * root).has_value());
  EXPECT_FALSE(InvertInformation(Matrix6d::Zero()).has_value());
  EXPECT_FALSE(InvertInformation(Matrix6d::Constant(std::nan(""))).has_value());
}

}  // namespace
}  // namespace panofix
