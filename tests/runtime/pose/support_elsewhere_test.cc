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
  return {own.support,
          SupportElsewhere(context, own.cam_from_local, {street.CamFromLocal(rough, heading_deg)})};
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
  const Rigid3 truth = Street().CamFromLocal(kPlace, kHeading_deg);
  const FrameFeatures frame = Street().Frame(truth, 0.5, 100);
  EXPECT_EQ(SupportElsewhere(Street().Context(frame, options), truth, {}), 0);
}

}  // namespace
}  // namespace panofix
