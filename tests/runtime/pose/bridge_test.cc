#include "runtime/pose/bridge.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/runtime/pose/synthetic_street.h"
#include "tests/support/matchers.h"

namespace panofix {
namespace {

constexpr double kPixelSigma = 0.3, kHeading_deg = 60, kStep_m = 0.6, kFirst_m = 10;
constexpr int kFrames = 6;
constexpr std::int64_t kFrame_ns = 100'000'000;
// Points between keyframes are good to some per cent of their range; one step leans on them.
constexpr double kTol_m = 0.06, kTol_rad = 0.006;

// Frames are to share more points than the other tests need.
const SyntheticStreet& Dense() {
  static const SyntheticStreet street(StreetShape::kTwoWalls, 4000);
  return street;
}

Rigid3 PoseAt(double y) { return Dense().CamFromLocal({0, y, 1.6}, kHeading_deg); }
const double kNext_m = kFirst_m + kStep_m * kFrames;

// As if all that the map knows had been built anew: what frames see is theirs alone.
FrameFeatures Rebuilt(FrameFeatures frame) {
  for (std::size_t i = 0; i < frame.sift.size(); ++i) {
    auto* descriptor = frame.sift.descriptors.data() + i * kDescriptorSize;
    std::rotate(descriptor, descriptor + 64, descriptor + kDescriptorSize);
  }
  return frame;
}
FrameFeatures FrameAt(double y) { return Dense().Frame(PoseAt(y), kPixelSigma, 100); }

// Keyframes whose poses are all off by `shift` (local frame) and known to `sigma_m`.
RecentPoints Recent(bool is_rebuilt, const Eigen::Vector3d& shift, double sigma_m) {
  RecentFrames recent;
  PoseOutcome known;
  known.covariance = Matrix6d::Zero();
  known.covariance.diagonal() << Eigen::Vector3d::Constant(sigma_m * sigma_m),
      Eigen::Vector3d::Constant(1e-6);
  for (int i = 0; i < kFrames; ++i) {
    const double y = kFirst_m + kStep_m * i;
    const Rigid3 local_from_cam = PoseAt(y).Inverse();
    const FrameFeatures frame = FrameAt(y);
    recent.Add(i * kFrame_ns,
               {local_from_cam.rotation, Dense().local().ToMap(local_from_cam.translation + shift)},
               known, is_rebuilt ? Rebuilt(frame) : frame);
  }
  return recent.Triangulate(Dense().camera(), Dense().local(), {});
}

PoseOutcome Bridge(const FrameFeatures& frame, const RecentPoints& recent,
                   const std::vector<Rigid3>& predictions) {
  PoseOptions options;
  options.ransac.focal_px = Dense().camera().fx_px;
  return BridgePose(Dense().Context(frame, options), recent, predictions);
}

double PositionSigma(const PoseOutcome& outcome) {
  return std::sqrt(outcome.covariance.topLeftCorner<3, 3>().trace() / 3);
}

TEST(BridgePose, CarriesOnWhereTheMapKnowsNothing) {
  constexpr double kSigma_m = 0.05;
  const RecentPoints recent = Recent(true, Eigen::Vector3d::Zero(), kSigma_m);
  const FrameFeatures frame = Rebuilt(FrameAt(kNext_m));
  const PoseOutcome outcome = Bridge(frame, recent, {PoseAt(kNext_m + 0.3)});
  ASSERT_TRUE(outcome.trusted) << outcome.reason;
  EXPECT_FALSE(outcome.degraded);
  EXPECT_THAT(outcome.cam_from_local.Inverse(),
              Rigid3Near(PoseAt(kNext_m).Inverse(), kTol_rad, kTol_m));
  EXPECT_NEAR(outcome.unmapped_m, kStep_m, 0.1);
  EXPECT_TRUE(outcome.views.empty());
  // Never better known than where it comes from.
  EXPECT_GT(PositionSigma(outcome), kSigma_m);
  EXPECT_LT(PositionSigma(outcome), 2 * kSigma_m);
}

TEST(BridgePose, TheWayWithoutTheMapMakesItUncertain) {
  RecentPoints recent = Recent(true, Eigen::Vector3d::Zero(), 0.05);
  const FrameFeatures frame = Rebuilt(FrameAt(kNext_m));
  double last = 0;
  for (const double unmapped_m : {0.0, 10.0, 40.0}) {
    recent.unmapped_m = unmapped_m;
    const double sigma = PositionSigma(Bridge(frame, recent, {PoseAt(kNext_m)}));
    EXPECT_GT(sigma, last);
    last = sigma;
  }
  recent.keyframe.position_sigma_m = 0.5;
  const PoseOutcome vague = Bridge(frame, recent, {PoseAt(kNext_m)});
  EXPECT_TRUE(vague.trusted && vague.degraded) << vague.reason;
  EXPECT_EQ(vague.reason, "pose_uncertain");
  recent.keyframe.position_sigma_m = 2;
  EXPECT_FALSE(Bridge(frame, recent, {PoseAt(kNext_m)}).trusted);
}

// Keyframes 20 cm off: the map, where it is seen again, has the last word.
TEST(BridgePose, LandmarksOfTheMapEndTheDrift) {
  const Eigen::Vector3d shift(0.12, -0.16, 0);
  RecentPoints recent = Recent(false, shift, 0.2);
  recent.unmapped_m = 10;
  const FrameFeatures frame = FrameAt(kNext_m);
  const PoseOutcome outcome = Bridge(frame, recent, {PoseAt(kNext_m)});
  ASSERT_TRUE(outcome.trusted) << outcome.reason;
  EXPECT_THAT(outcome.cam_from_local.Inverse(),
              Rigid3Near(PoseAt(kNext_m).Inverse(), kTol_rad, kTol_m));
  EXPECT_EQ(outcome.unmapped_m, 0);
}

TEST(BridgePose, WhatWasNotSeenBeforeGivesNoPose) {
  const RecentPoints recent = Recent(true, Eigen::Vector3d::Zero(), 0.05);
  // The frame shows the street as the map knows it, keyframes another.
  EXPECT_FALSE(Bridge(FrameAt(kNext_m), recent, {PoseAt(kNext_m)}).trusted);
  EXPECT_FALSE(Bridge({}, recent, {PoseAt(kNext_m)}).trusted);
  EXPECT_FALSE(Bridge(Rebuilt(FrameAt(kNext_m)), recent, {}).trusted);
  const PoseOutcome nothing = Bridge(Rebuilt(FrameAt(kNext_m)), {}, {PoseAt(kNext_m)});
  EXPECT_FALSE(nothing.trusted);
  EXPECT_EQ(nothing.reason, "too_few_matches");
}

// Nobody jumps between two frames.
TEST(BridgePose, FarFromThePredictionIsNoPose) {
  const RecentPoints recent = Recent(true, Eigen::Vector3d::Zero(), 0.05);
  const FrameFeatures frame = Rebuilt(FrameAt(kNext_m));
  const PoseOutcome outcome = Bridge(frame, recent, {PoseAt(kNext_m + 2)});
  EXPECT_FALSE(outcome.trusted);
}

}  // namespace
}  // namespace panofix
