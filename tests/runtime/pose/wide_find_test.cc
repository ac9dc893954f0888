// Finds that are not sure: made of the landmarks of more stations, and looked for where the last
// such finds were.
#include <gtest/gtest.h>

#include "runtime/pose/pose_estimator.h"
#include "tests/runtime/pose/synthetic_street.h"
#include "tests/support/matchers.h"

namespace panofix {
namespace {

constexpr double kPixelSigma = 0.5, kTol_m = 0.05, kTol_rad = 0.005;
const Eigen::Vector3d kPlace(0.8, 14, 1.6);

PoseOptions Options() {
  PoseOptions options;
  options.ransac.focal_px = Street().camera().fx_px;
  return options;
}

FrameFeatures SomeFrame() {
  return Street().Frame(Street().CamFromLocal(kPlace, 10), kPixelSigma, 100);
}

TEST(WideFind, TakesMoreStationsAndCountsTheNearestAlone) {
  const FrameFeatures frame = SomeFrame();
  PoseOptions options = Options();
  options.landmarks.num_stations = 1;
  options.find_inliers = 10'000;  // no find is sure
  options.use_wide = false;
  const auto views = Street().Match(frame, 2, 2);
  const PoseOutcome near = EstimatePose(Street().Context(frame, options), views);
  options.use_wide = true;
  const PoseOutcome wide = EstimatePose(Street().Context(frame, options), views);
  ASSERT_TRUE(near.found && wide.found) << near.reason << " " << wide.reason;
  EXPECT_TRUE(near.unconfirmed && wide.unconfirmed);
  EXPECT_FALSE(near.trusted || wide.trusted);
  EXPECT_EQ(near.num_near_inliers, near.num_inliers);
  EXPECT_GT(wide.num_inliers, wide.num_near_inliers);
  EXPECT_GT(wide.num_inliers, near.num_inliers);
  EXPECT_NEAR(wide.support, near.support, 0.05);
  EXPECT_THAT(wide.cam_from_local.Inverse(),
              Rigid3Near(Street().CamFromLocal(kPlace, 10).Inverse(), kTol_rad, kTol_m));
}

TEST(WideFind, FirmMatchesMakeItSure) {
  const FrameFeatures frame = SomeFrame();
  PoseOptions options = Options();
  options.find_inliers = 10'000;
  const auto views = Street().Match(frame, 0, 5);
  const PoseOutcome weak = EstimatePose(Street().Context(frame, options), views);
  EXPECT_TRUE(weak.unconfirmed && !weak.trusted) << weak.reason;
  options.find_firm = weak.num_firm;
  EXPECT_TRUE(EstimatePose(Street().Context(frame, options), views).trusted);
}

TEST(WideFind, ASureFindIsLeftAsItIs) {
  const FrameFeatures frame = SomeFrame();
  PoseOptions options = Options();
  const auto views = Street().Match(frame, 0, 5);
  const PoseOutcome with = EstimatePose(Street().Context(frame, options), views);
  options.use_wide = false;
  const PoseOutcome without = EstimatePose(Street().Context(frame, options), views);
  ASSERT_TRUE(with.trusted) << with.reason;
  EXPECT_EQ(with.cam_from_local.translation, without.cam_from_local.translation);
  EXPECT_EQ(with.num_inliers, with.num_near_inliers);
}

TEST(WideFind, LooksWhereTheLastFindsWere) {
  const FrameFeatures frame = SomeFrame();
  const PoseOptions options = Options();
  PoseContext context = Street().Context(frame, options);
  EXPECT_FALSE(EstimatePose(context, {}).found);
  context.last_finds = {Street().CamFromLocal(kPlace - Eigen::Vector3d(0.1, 0.8, 0), 9)};
  const PoseOutcome outcome = EstimatePose(context, {});
  ASSERT_TRUE(outcome.found) << outcome.reason;
  EXPECT_GT(outcome.num_inliers, outcome.num_near_inliers);
  EXPECT_THAT(outcome.cam_from_local.Inverse(),
              Rigid3Near(Street().CamFromLocal(kPlace, 10).Inverse(), kTol_rad, kTol_m));
}

TEST(WideFind, AWeakTrackedPoseTakesMoreStationsToo) {
  const FrameFeatures frame = SomeFrame();
  PoseOptions options = Options();
  options.landmarks.num_stations = 1;
  options.weak_inliers = 10'000;
  const std::vector<Rigid3> predictions = {
      Street().CamFromLocal(kPlace - Eigen::Vector3d(0, 0.5, 0), 10)};
  const PoseOutcome wide = TrackPose(Street().Context(frame, options), predictions);
  options.use_wide = false;
  const PoseOutcome near = TrackPose(Street().Context(frame, options), predictions);
  ASSERT_TRUE(near.trusted && wide.trusted) << near.reason << " " << wide.reason;
  EXPECT_GT(wide.num_inliers, near.num_inliers);
}

}  // namespace
}  // namespace panofix
