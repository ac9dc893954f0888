// Past fixes in the final adjustment of a pose.

#include <gtest/gtest.h>

#include "runtime/pose/pose_estimator.h"
#include "tests/runtime/pose/synthetic_street.h"
#include "tests/support/matchers.h"

namespace panofix {
namespace {

constexpr double kPixelSigma = 0.5, kTol_m = 0.05, kTol_rad = 0.005;  // as in track_pose_test.cc

PoseOutcome Track(const Eigen::Vector3d& place, const std::vector<PastFrame>& past) {
  PoseOptions options;
  options.ransac.focal_px = Street().camera().fx_px;
  const Rigid3 truth = Street().CamFromLocal(place, 10);
  const FrameFeatures frame = Street().Frame(truth, kPixelSigma, 100);
  PoseContext context = Street().Context(frame, options);
  context.past = past;
  return TrackPose(context, {Street().CamFromLocal(place + Eigen::Vector3d(-0.4, 0.5, 0), 12)});
}

double Trace(const PoseOutcome& outcome) {
  return outcome.covariance.topLeftCorner<3, 3>().trace();
}

TEST(TrackPoseWithPastFrames, SharpenThePose) {
  const Eigen::Vector3d place(0.8, 14, 1.6);
  const PoseOutcome before = Track(place - Eigen::Vector3d(0, 1.5, 0), {});
  ASSERT_TRUE(before.trusted) << before.reason;
  ASSERT_GT(before.agreed.size(), 50U);
  const PoseOutcome alone = Track(place, {});
  const PoseOutcome joint = Track(place, {{before.cam_from_local, before.agreed}});
  ASSERT_TRUE(alone.trusted && joint.trusted) << alone.reason << " " << joint.reason;
  EXPECT_LT(Trace(joint), Trace(alone));
  const Rigid3 truth = Street().CamFromLocal(place, 10);
  EXPECT_THAT(joint.cam_from_local.Inverse(), Rigid3Near(truth.Inverse(), kTol_rad, kTol_m));
}

TEST(TrackPoseWithPastFrames, AWrongOneChangesNothing) {
  const Eigen::Vector3d place(0.8, 14, 1.6);
  const PoseOutcome before = Track(place - Eigen::Vector3d(0, 1.5, 0), {});
  const PoseOutcome alone = Track(place, {});
  // Its matches, at a pose that they contradict.
  const PoseOutcome joint =
      Track(place, {{Street().CamFromLocal({0, 40, 1.6}, 180), before.agreed}});
  ASSERT_TRUE(before.trusted && alone.trusted && joint.trusted);
  EXPECT_EQ(joint.cam_from_local.translation, alone.cam_from_local.translation);
  EXPECT_EQ(joint.covariance, alone.covariance);
}

}  // namespace
}  // namespace panofix
