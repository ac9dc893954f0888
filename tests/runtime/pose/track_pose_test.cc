#include <gtest/gtest.h>

#include "runtime/pose/pose_estimator.h"
#include "tests/runtime/pose/synthetic_street.h"
#include "tests/support/matchers.h"

namespace panofix {
namespace {

// Half a pixel of noise over some 200 landmarks; landmarks are exact, but their ranges count as
// known to a tenth.
constexpr double kPixelSigma = 0.5, kTol_m = 0.05, kTol_rad = 0.006;

PoseOptions Options() {
  PoseOptions options;
  options.ransac.focal_px = Street().camera().fx_px;
  return options;
}

PoseOutcome Track(const FrameFeatures& frame, const std::vector<Rigid3>& predictions) {
  const PoseOptions options = Options();
  return TrackPose(Street().Context(frame, options), predictions);
}

const Eigen::Vector3d kPlace(0.8, 14, 1.6);
constexpr double kHeading_deg = 10;

FrameFeatures SomeFrame() {
  return Street().Frame(Street().CamFromLocal(kPlace, kHeading_deg), kPixelSigma, 100);
}

TEST(TrackPose, FindsThePoseFromAnErringPrediction) {
  for (const double y : {3.0, 14.5, 26.0}) {
    for (const double heading_deg : {0.0, 40.0, 180.0}) {
      const Eigen::Vector3d place(0.8, y, 1.6);
      const Rigid3 truth = Street().CamFromLocal(place, heading_deg);
      const FrameFeatures frame = Street().Frame(truth, kPixelSigma, 100);
      const PoseOutcome outcome = Track(
          frame, {Street().CamFromLocal(place + Eigen::Vector3d(-0.4, 0.9, 0.1), heading_deg + 3)});
      ASSERT_TRUE(outcome.found) << outcome.reason;
      EXPECT_TRUE(outcome.trusted) << outcome.reason;
      EXPECT_FALSE(outcome.degraded) << outcome.reason;
      EXPECT_THAT(outcome.cam_from_local.Inverse(), Rigid3Near(truth.Inverse(), kTol_rad, kTol_m))
          << y << " " << heading_deg;
      EXPECT_GT(outcome.num_inliers, 50);
    }
  }
}

// The same landmarks support both: one pose, whichever way leads to it.
TEST(TrackPose, AgreesWithRetrieval) {
  const FrameFeatures frame = SomeFrame();
  const PoseOptions options = Options();
  const PoseOutcome retrieved =
      EstimatePose(Street().Context(frame, options), Street().Match(frame, 0, 4));
  const PoseOutcome tracked =
      Track(frame, {Street().CamFromLocal(kPlace + Eigen::Vector3d(0, -0.8, 0), kHeading_deg - 2)});
  ASSERT_TRUE(retrieved.trusted && tracked.trusted) << retrieved.reason << " " << tracked.reason;
  EXPECT_THAT(tracked.cam_from_local.Inverse(),
              Rigid3Near(retrieved.cam_from_local.Inverse(), kTol_rad, kTol_m));
  EXPECT_NEAR(tracked.support, retrieved.support, 0.05);
  // Sigmas of one scale.
  const auto sigma_m = [](const PoseOutcome& o) {
    return std::sqrt(o.covariance.topLeftCorner<3, 3>().trace());
  };
  EXPECT_LT(sigma_m(tracked), 2 * sigma_m(retrieved));
  EXPECT_GT(sigma_m(tracked), 0.5 * sigma_m(retrieved));
}

TEST(TrackPose, TheFirstPredictionThatPassesIsTaken) {
  const FrameFeatures frame = SomeFrame();
  const Rigid3 wrong = Street().CamFromLocal({0, 40, 1.6}, 180),
               right = Street().CamFromLocal(kPlace + Eigen::Vector3d(0, 0.5, 0), kHeading_deg);
  for (const auto& predictions : {std::vector{wrong, right}, {right, wrong}}) {
    const PoseOutcome outcome = Track(frame, predictions);
    ASSERT_TRUE(outcome.trusted) << outcome.reason;
    EXPECT_THAT(outcome.cam_from_local,
                Rigid3Near(Street().CamFromLocal(kPlace, kHeading_deg), kTol_rad, kTol_m));
  }
}

TEST(TrackPose, IsDeterministic) {
  const FrameFeatures frame = SomeFrame();
  const std::vector<Rigid3> predictions{Street().CamFromLocal(kPlace, kHeading_deg + 2)};
  const PoseOutcome a = Track(frame, predictions), b = Track(frame, predictions);
  EXPECT_EQ(a.cam_from_local.translation, b.cam_from_local.translation);
  EXPECT_EQ(a.covariance, b.covariance);
  EXPECT_EQ(a.num_inliers, b.num_inliers);
}

TEST(TrackPose, AWrongPredictionGivesNoPose) {
  const FrameFeatures frame = SomeFrame();
  for (const Rigid3& wrong : {Street().CamFromLocal(kPlace, kHeading_deg + 180),
                              Street().CamFromLocal({0, 40, 1.6}, kHeading_deg),
                              Street().CamFromLocal({0, 5000, 1.6}, kHeading_deg)}) {
    const PoseOutcome outcome = Track(frame, {wrong});
    EXPECT_FALSE(outcome.trusted);
    EXPECT_NE(outcome.reason, "");
  }
}

TEST(TrackPose, NothingToGoByIsSaid) {
  const PoseOutcome no_prediction = Track(SomeFrame(), {});
  EXPECT_FALSE(no_prediction.found);
  EXPECT_EQ(no_prediction.reason, "no_consensus");
  const PoseOutcome no_feature = Track({}, {Street().CamFromLocal(kPlace, kHeading_deg)});
  EXPECT_FALSE(no_feature.found);
  EXPECT_EQ(no_feature.reason, "no_consensus");
}

}  // namespace
}  // namespace panofix
