#include <gtest/gtest.h>

#include "runtime/pose/pose_estimator.h"
#include "tests/runtime/pose/synthetic_street.h"

namespace panofix {
namespace {

const Eigen::Vector3d kPlace(0.8, 4, 1.6), kTwin(0.8, 4 + kTwinPeriod_m, 1.6);
constexpr double kHeading_deg = 10;

// Support at the true place and the most that is found around `rough`.
struct Supports {
  double own = 0, elsewhere = 0;
};
Supports Ask(const SyntheticStreet& street, const Eigen::Vector3d& rough, double heading_deg) {
  PoseOptions options;
  options.ransac.focal_px = street.camera().fx_px;
  const Rigid3 truth = street.CamFromLocal(kPlace, kHeading_deg);
  const FrameFeatures frame = street.Frame(truth, 0.5, 100);
  const PoseContext context = street.Context(frame, options);
  const PoseOutcome own = TrackPose(context, {truth});
  EXPECT_TRUE(own.trusted) << own.reason;
  return {own.support, SupportElsewhere(context, own, {street.CamFromLocal(rough, heading_deg)})};
}

const SyntheticStreet& Twins() {
  static const SyntheticStreet street(StreetShape::kTwins);
  return street;
}

TEST(SupportElsewhere, ATwinHasAsMuch) {
  const Eigen::Vector3d beside_twin = kTwin + Eigen::Vector3d(-0.3, 0.8, 0);
  const Supports supports = Ask(Twins(), beside_twin, kHeading_deg + 4);
  EXPECT_GT(supports.elsewhere, 0.7 * supports.own);
}

// A row of equal windows lends a place a part of what the right pose shows, however large its share
// of the little to be seen there.
TEST(SupportElsewhere, APartOfTheFirmMatchesIsNoRivalButForASureFind) {
  PoseOptions options;
  options.ransac.focal_px = Twins().camera().fx_px;
  const FrameFeatures frame = Twins().Frame(Twins().CamFromLocal(kPlace, kHeading_deg), 0.5, 100);
  const PoseContext context = Twins().Context(frame, options);
  PoseOutcome own = TrackPose(context, {Twins().CamFromLocal(kPlace, kHeading_deg)});
  const std::vector<Rigid3> twin = {Twins().CamFromLocal(kTwin, kHeading_deg)};
  EXPECT_GT(SupportElsewhere(context, own, twin), 0);
  own.num_firm += 1000;  // more than any place here has
  EXPECT_GT(SupportElsewhere(context, own, twin), 0);
  options.find_inliers = 10'000;  // no find is sure
  EXPECT_EQ(SupportElsewhere(context, own, twin), 0);
}

TEST(SupportElsewhere, AStreetOfItsOwnHasNone) {
  const Supports supports = Ask(Street(), kTwin, kHeading_deg);
  EXPECT_GT(supports.own, 0.2);
  EXPECT_LT(supports.elsewhere, 0.1 * supports.own);
}

// However it is found: the pose itself is no rival of its own.
TEST(SupportElsewhere, ThePlaceItselfIsNotElsewhere) {
  const Supports supports = Ask(Street(), kPlace + Eigen::Vector3d(0, 1, 0), kHeading_deg);
  EXPECT_EQ(supports.elsewhere, 0);
}

TEST(SupportElsewhere, NowhereToAskIsNoRival) {
  PoseOptions options;
  options.ransac.focal_px = Street().camera().fx_px;
  PoseOutcome own;
  own.cam_from_local = Street().CamFromLocal(kPlace, kHeading_deg);
  const FrameFeatures frame = Street().Frame(own.cam_from_local, 0.5, 100);
  EXPECT_EQ(SupportElsewhere(Street().Context(frame, options), own, {}), 0);
}

}  // namespace
}  // namespace panofix
