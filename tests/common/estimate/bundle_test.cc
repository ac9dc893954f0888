#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/estimate/bundle_residual.h"
#include "common/estimate/refine.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_pose.h"

namespace panofix {
namespace {

constexpr double kStep = 1e-6;
constexpr double kDifferenceTolerance = 2e-6;  // relative; steps of 1e-6 leave about 1e-8

Vector6d SmallDelta(Rng* rng) {
  Vector6d delta;
  delta << 0.2 * RandomNormal3(rng), 0.05 * RandomNormal3(rng);
  return delta;
}

TEST(LeftJacobianSo3, EqualsDifferences) {
  Rng rng(1, "tests/left_jacobian");
  for (const double size : {1e-6, 1e-3, 0.5, 2.0}) {
    const Eigen::Vector3d phi = size * RandomNormal3(&rng).normalized();
    const Eigen::Matrix3d analytic = LeftJacobianSo3(phi);
    for (Eigen::Index k = 0; k < 3; ++k) {
      const Eigen::Vector3d step = kStep * Eigen::Vector3d::Unit(k);
      const Eigen::Quaterniond turn = ExpSo3(phi + step) * ExpSo3(phi - step).conjugate();
      const Eigen::Vector3d numeric = 2 * turn.vec() / (2 * kStep);
      EXPECT_LT((numeric - analytic.col(k)).norm(), 1e-8) << size;
    }
  }
}

TEST(LinearizeBundle, JacobiansEqualDifferences) {
  SyntheticPoseOptions options;
  options.range_sigma_share = 0.05;
  options.pixel_sigma = 1;
  const SyntheticPose world = MakeSyntheticPose(options, 2);
  Rng rng(2, "tests/bundle_residual");
  int checked = 0;
  for (Correspondence match : world.matches) {
    // A plane that faces the panorama, more or less.
    match.surface_normal_in_map =
        (match.lever_in_map.normalized() + 0.3 * RandomNormal3(&rng)).normalized();
    const BundleMatch prepared(match);
    const Vector6d panorama = SmallDelta(&rng);
    const Eigen::Vector3d surface = SmallDelta(&rng).head<3>();
    BundleLinear linear;
    if (!LinearizeBundle(prepared, CameraFrame(world.cam_from_map), PanoramaMotion(panorama),
                         surface, &linear)) {
      continue;
    }
    ++checked;
    const auto residual_at = [&](const Vector6d& f, const Vector6d& p, const Eigen::Vector3d& s) {
      Eigen::Vector2d residual = Eigen::Vector2d::Constant(NAN);
      const CameraFrame frame(PerturbPose(world.cam_from_map, f));
      EXPECT_TRUE(
          BundleResidual(prepared, linear.whitener, frame, PanoramaMotion(p), s, &residual));
      return residual;
    };
    EXPECT_LT((linear.residual - residual_at(Vector6d::Zero(), panorama, surface)).norm(),
              1e-9 * (1 + linear.residual.norm()));
    for (Eigen::Index k = 0; k < 6; ++k) {
      const Vector6d step = kStep * Vector6d::Unit(k);
      const Eigen::Vector2d by_frame =
          (residual_at(step, panorama, surface) - residual_at(-step, panorama, surface)) /
          (2 * kStep);
      EXPECT_LT((by_frame - linear.by_frame.col(k)).norm(),
                kDifferenceTolerance * (1 + linear.by_frame.norm()));
      const Vector6d zero = Vector6d::Zero();
      const Eigen::Vector2d by_panorama = (residual_at(zero, panorama + step, surface) -
                                           residual_at(zero, panorama - step, surface)) /
                                          (2 * kStep);
      EXPECT_LT((by_panorama - linear.by_panorama.col(k)).norm(),
                kDifferenceTolerance * (1 + linear.by_panorama.norm()));
    }
    for (Eigen::Index k = 0; k < 3; ++k) {
      const Eigen::Vector3d step = kStep * Eigen::Vector3d::Unit(k);
      const Vector6d zero = Vector6d::Zero();
      const Eigen::Vector2d by_surface = (residual_at(zero, panorama, surface + step) -
                                          residual_at(zero, panorama, surface - step)) /
                                         (2 * kStep);
      EXPECT_LT((by_surface - linear.by_surface.col(k)).norm(),
                kDifferenceTolerance * (1 + linear.by_surface.norm()));
    }
  }
  EXPECT_GT(checked, 150);
}

// The row against the plane equation itself: n' . X = d' with the errors put in.
TEST(SurfaceRow, IsTheRangeChangeOfAMovedPlane) {
  Rng rng(3, "tests/surface_row");
  for (int trial = 0; trial < 200; ++trial) {
    Correspondence match;
    match.lever_in_map = 10 * RandomNormal3(&rng).normalized();
    match.surface_normal_in_map =
        (match.lever_in_map.normalized() + 0.4 * RandomNormal3(&rng)).normalized();
    const Eigen::Vector3d n = match.surface_normal_in_map, e1 = n.unitOrthogonal(),
                          e2 = n.cross(e1);
    const Eigen::Vector3d v = match.lever_in_map.normalized();
    if (n.dot(v) < 0.3) continue;
    const double d = n.dot(match.lever_in_map);
    const Eigen::Vector3d delta = 1e-5 * RandomNormal3(&rng);
    const Eigen::Vector3d moved_normal = n + delta(1) * e1 + delta(2) * e2;
    const double moved_range = d * (1 + delta(0)) / moved_normal.dot(v);
    EXPECT_NEAR(moved_range / 10 - 1, SurfaceRow(match).dot(delta), 1e-8);  // second order of 1e-5
  }
}

// Points on few planes whose errors they share: the adjustment knows its own error, and the
// refinement, which takes them for independent, is overconfident.
TEST(LocalBundleAdjustment, IsCalibratedForErrorsSharedByAPlane) {
  constexpr int kTrials = 300, kPlanes = 4;
  constexpr double kDistanceSigma = 0.03;
  std::vector<double> nees_bundle, nees_refine;
  for (int trial = 0; trial < kTrials; ++trial) {
    SyntheticPoseOptions options;
    options.pixel_sigma = 0.7;
    options.num_panoramas = 1;
    SyntheticPose world = MakeSyntheticPose(options, 100 + trial);
    Rng rng(static_cast<std::uint64_t>(trial), "tests/shared_planes");
    std::vector<double> error(kPlanes);
    for (double& e : error) e = kDistanceSigma * rng.Normal();
    for (std::size_t i = 0; i < world.matches.size(); ++i) {
      Correspondence& match = world.matches[i];
      match.surface_id = static_cast<int>(i % kPlanes);
      match.surface_distance_sigma = kDistanceSigma;
      match.range_sigma_in_map = kDistanceSigma * match.lever_in_map;
      const double own = 1e-3;  // keeps the own error above zero, as the map does
      match.range_sigma_in_map *= std::sqrt(1 + own);
      const double stretch = error[i % kPlanes];
      match.point_in_map += stretch * match.lever_in_map;
      match.lever_in_map *= 1 + stretch;
    }
    const RefineResult refined = RefinePose(world.matches, world.cam_from_map, {});
    const PanoramaPrior prior{world.matches[0].panorama_idx, 1e-4, 1e-5, 1e-5};
    const BundleResult adjusted =
        LocalBundleAdjustment(world.matches, refined.cam_from_map, {&prior, 1}, {});
    ASSERT_TRUE(refined.success && adjusted.success);
    const auto nees = [&](const Rigid3& pose, const Matrix6d& covariance) {
      const Vector6d e = PoseError(pose, world.cam_from_map);
      return e.dot(covariance.ldlt().solve(e));
    };
    nees_bundle.push_back(nees(adjusted.cam_from_map, adjusted.covariance));
    nees_refine.push_back(nees(refined.cam_from_map, refined.covariance));
  }
  const auto median = [](std::vector<double> v) {
    std::nth_element(v.begin(), v.begin() + v.size() / 2, v.end());
    return v[v.size() / 2];
  };
  constexpr double kExpected = 5.348;                       // median of chi-square with 6
  EXPECT_NEAR(median(nees_bundle) / kExpected, 1.0, 0.35);  // own error kept at a tenth widens it
  EXPECT_GT(median(nees_refine), 1.5 * median(nees_bundle));
}

TEST(SqrtInformation, WhitensItsCovariance) {
  Eigen::Matrix2d covariance;
  covariance << 4, 1.5, 1.5, 2;
  const Eigen::Matrix2d whitener = SqrtInformation(covariance);
  EXPECT_LT((whitener * covariance * whitener.transpose() - Eigen::Matrix2d::Identity()).norm(),
            1e-14);
}

TEST(LocalBundleAdjustment, CleanMatchesGiveTheTruth) {
  SyntheticPoseOptions options;
  const SyntheticPose world = MakeSyntheticPose(options, 3);
  std::vector<PanoramaPrior> priors = world.priors;
  for (PanoramaPrior& prior : priors) prior = PanoramaPrior{prior.panorama_idx};
  const Rigid3 start = PerturbPose(world.cam_from_map, Vector6d::Constant(0.005));
  const BundleResult result = LocalBundleAdjustment(world.matches, start, priors, {});
  ASSERT_TRUE(result.success);
  EXPECT_THAT(result.cam_from_map.Inverse(), Rigid3Near(world.cam_from_map.Inverse(), 1e-5, 1e-4));
  ASSERT_EQ(result.panorama_shift_m.size(), priors.size());
  for (const double shift_m : result.panorama_shift_m) EXPECT_LT(shift_m, 1e-3);
}

TEST(LocalBundleAdjustment, WithoutPriorsItIsTheRefinement) {
  SyntheticPoseOptions options;
  options.pixel_sigma = 0.7;
  options.range_sigma_share = 0.03;
  options.outlier_share = 0.1;
  const SyntheticPose world = MakeSyntheticPose(options, 4);
  const RefineResult refined = RefinePose(world.matches, world.cam_from_map, {});
  const BundleResult bundled = LocalBundleAdjustment(world.matches, world.cam_from_map, {}, {});
  ASSERT_TRUE(refined.success && bundled.success);
  // Two solvers, one estimator: they stop within a hundredth of a sigma of each other.
  EXPECT_THAT(bundled.cam_from_map.Inverse(),
              Rigid3Near(refined.cam_from_map.Inverse(), 1e-5, 1e-4));
  EXPECT_LT((bundled.covariance - refined.covariance).norm(), 0.01 * refined.covariance.norm());
  EXPECT_EQ(bundled.num_inliers, refined.num_inliers);
}

struct MeanErrors {
  double refined_m = 0, bundled_m = 0;
};

// One panorama vouches for most matches and is shifted; the priors are as given.
MeanErrors ErrorsWithShiftedPanorama(double shift_m, double shifted_prior_m, double other_prior_m) {
  constexpr int kTrials = 40;
  MeanErrors errors;
  for (std::uint64_t seed = 0; seed < kTrials; ++seed) {
    SyntheticPoseOptions options;
    options.num_matches = 400;
    options.num_panoramas = 4;
    options.pixel_sigma = 0.7;
    SyntheticPose world = MakeSyntheticPose(options, seed);
    for (PanoramaPrior& prior : world.priors) {
      prior = {prior.panorama_idx, prior.panorama_idx == 0 ? shifted_prior_m : other_prior_m};
    }
    Rng rng(seed, "tests/shifted_panorama");
    const Eigen::Vector3d shift = shift_m * RandomNormal3(&rng).normalized();
    std::vector<Correspondence> matches;
    for (std::size_t i = 0; i < world.matches.size(); ++i) {
      Correspondence match = world.matches[i];
      // All of the first panorama's hundred, a dozen of each other.
      if (match.panorama_idx != 0 && i % 8 != 0) continue;
      if (match.panorama_idx == 0) match.point_in_map += shift;
      matches.push_back(match);
    }
    const RefineResult refined = RefinePose(matches, world.cam_from_map, {});
    const BundleResult bundled =
        LocalBundleAdjustment(matches, world.cam_from_map, world.priors, {});
    EXPECT_TRUE(refined.success && bundled.success) << seed;
    errors.refined_m +=
        PoseError(refined.cam_from_map, world.cam_from_map).head<3>().norm() / kTrials;
    errors.bundled_m +=
        PoseError(bundled.cam_from_map, world.cam_from_map).head<3>().norm() / kTrials;
  }
  return errors;
}

TEST(LocalBundleAdjustment, RecoversFromTheShiftOfTheMainPanorama) {
  const MeanErrors known_to_be_loose = ErrorsWithShiftedPanorama(0.1, 0.1, 0.01);
  EXPECT_LT(known_to_be_loose.bundled_m, 0.5 * known_to_be_loose.refined_m);
  // All equally trusted: the bundle weighs panoramas, the refinement counts matches.
  const MeanErrors equal = ErrorsWithShiftedPanorama(0.1, 0.05, 0.05);
  EXPECT_LT(equal.bundled_m, equal.refined_m);
}

TEST(LocalBundleAdjustment, NamesThePanoramaThatIsOff) {
  SyntheticPoseOptions options;
  options.num_panoramas = 4;
  options.num_matches = 300;
  options.pixel_sigma = 0.5;
  SyntheticPose world = MakeSyntheticPose(options, 6);
  for (PanoramaPrior& prior : world.priors) prior = PanoramaPrior{prior.panorama_idx};
  for (Correspondence& match : world.matches) {
    if (match.panorama_idx == 2) match.point_in_map += Eigen::Vector3d(0.15, -0.1, 0.05);
  }
  const BundleResult result =
      LocalBundleAdjustment(world.matches, world.cam_from_map, world.priors, {});
  ASSERT_TRUE(result.success);
  const auto largest =
      std::max_element(result.panorama_shift_m.begin(), result.panorama_shift_m.end());
  EXPECT_EQ(largest - result.panorama_shift_m.begin(), 2);
}

TEST(LocalBundleAdjustment, PanoramaErrorsWidenTheCovariance) {
  SyntheticPoseOptions options;
  options.pixel_sigma = 0.5;
  SyntheticPose world = MakeSyntheticPose(options, 7);
  const auto sigma_m = [&](double prior_m) {
    for (PanoramaPrior& prior : world.priors) prior = PanoramaPrior{prior.panorama_idx, prior_m};
    const BundleResult result =
        LocalBundleAdjustment(world.matches, world.cam_from_map, world.priors, {});
    EXPECT_TRUE(result.success);
    return std::sqrt(result.covariance.topLeftCorner<3, 3>().trace() / 3);
  };
  EXPECT_LT(sigma_m(0), sigma_m(0.05));
  // Three panoramas of half a metre, averaged, cannot give better than 0.5 / sqrt(3).
  EXPECT_GT(sigma_m(0.5), 0.5 / std::sqrt(3.0));
}

TEST(LocalBundleAdjustment, SameInputSameBits) {
  SyntheticPoseOptions options;
  options.pixel_sigma = 0.7;
  options.outlier_share = 0.2;
  options.panorama_position_sigma_m = 0.05;
  const SyntheticPose world = MakeSyntheticPose(options, 8);
  const BundleResult a = LocalBundleAdjustment(world.matches, world.cam_from_map, world.priors, {});
  // Other heap addresses, same answer.
  const std::vector<Correspondence> copy = world.matches;
  const std::vector<double> ballast(100000, 1.0);
  const BundleResult b = LocalBundleAdjustment(copy, world.cam_from_map, world.priors, {});
  EXPECT_EQ(a.cam_from_map.translation, b.cam_from_map.translation);
  EXPECT_EQ(a.cam_from_map.rotation.coeffs(), b.cam_from_map.rotation.coeffs());
  EXPECT_EQ(a.covariance, b.covariance);
}

TEST(LocalBundleAdjustment, DegenerateInputFails) {
  SyntheticPoseOptions options;
  SyntheticPose world = MakeSyntheticPose(options, 9);
  EXPECT_FALSE(LocalBundleAdjustment({}, world.cam_from_map, world.priors, {}).success);
  const auto few = std::span(world.matches).first(3);
  const BundleResult result = LocalBundleAdjustment(few, world.cam_from_map, world.priors, {});
  EXPECT_FALSE(result.success);
  EXPECT_EQ(result.panorama_shift_m.size(), world.priors.size());
  const std::vector<Correspondence> same(20, world.matches[0]);
  EXPECT_FALSE(LocalBundleAdjustment(same, world.cam_from_map, {}, {}).success);
  options.layout = PointLayout::kLine;
  world = MakeSyntheticPose(options, 9);
  const BundleResult line =
      LocalBundleAdjustment(world.matches, world.cam_from_map, world.priors, {});
  EXPECT_TRUE(!line.success || line.covariance.diagonal().head(3).sum() > 1);
}

TEST(LocalBundleAdjustment, HostileNumbersAreLeftOut) {
  SyntheticPoseOptions options;
  SyntheticPose world = MakeSyntheticPose(options, 10);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  world.matches[0].bearing_in_cam.x() = nan;
  world.matches[1].lever_in_map.y() = std::numeric_limits<double>::infinity();
  world.matches[2].point_in_map.setConstant(std::numeric_limits<double>::max());
  world.matches[3].panorama_idx = 12345;  // no such prior: held fixed
  world.priors[0].position_sigma_m = nan;
  world.priors[1].heading_sigma_rad = -1;
  const BundleResult result =
      LocalBundleAdjustment(world.matches, world.cam_from_map, world.priors, {});
  ASSERT_TRUE(result.success);
  EXPECT_LT(PoseError(result.cam_from_map, world.cam_from_map).norm(), 1e-3);
  BundleOptions broken;
  broken.tukey_t = nan;
  EXPECT_FALSE(
      LocalBundleAdjustment(world.matches, world.cam_from_map, world.priors, broken).success);
  Rigid3 nowhere;
  nowhere.translation.x() = nan;
  EXPECT_FALSE(LocalBundleAdjustment(world.matches, nowhere, world.priors, {}).success);
}

}  // namespace
}  // namespace panofix
