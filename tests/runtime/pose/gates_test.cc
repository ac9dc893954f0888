#include "runtime/pose/gates.h"

#include <gtest/gtest.h>

#include <functional>
#include <limits>

#include "tests/runtime/pose/synthetic_street.h"

namespace panofix {
namespace {

const SyntheticStreet& Street() {
  static const SyntheticStreet street(StreetShape::kTwoWalls, 50);
  return street;
}

// A level camera in the street whose figures pass every gate.
PoseOutcome Sound() {
  PoseOutcome outcome;
  outcome.found = outcome.trusted = true;
  outcome.cam_from_local = Street().CamFromLocal({0, 12, 1.6}, 30);
  outcome.covariance = Matrix6d::Identity() * 1e-4;
  outcome.num_inliers = 100, outcome.spread = 0.5, outcome.support = 0.5, outcome.over_chance = 20;
  outcome.chi2_per_dof = 1, outcome.agreement = 0.9;
  return outcome;
}

std::string GateOf(const std::function<void(PoseOutcome*)>& change) {
  PoseOutcome outcome = Sound();
  change(&outcome);
  return FailedGate(outcome, *Street().bundle(), Street().local(), {});
}

TEST(FailedGate, ASoundPosePasses) {
  EXPECT_EQ(GateOf([](PoseOutcome*) {}), "");
}

TEST(FailedGate, EachFigureHasItsGate) {
  const PoseOptions o;
  EXPECT_EQ(GateOf([&](PoseOutcome* p) { p->num_inliers = o.min_inliers - 1; }), "too_few_inliers");
  EXPECT_EQ(GateOf([&](PoseOutcome* p) { p->spread = o.min_spread / 2; }), "inliers_clustered");
  EXPECT_EQ(GateOf([](PoseOutcome* p) { p->num_elsewhere = 90; }), "ambiguous_place");
  EXPECT_EQ(GateOf([](PoseOutcome* p) { p->support = 0; }), "landmarks_missing");
  EXPECT_EQ(GateOf([](PoseOutcome* p) { p->over_chance = 1; }), "landmarks_missing");
  EXPECT_EQ(GateOf([](PoseOutcome* p) { p->covariance *= 1e6; }), "pose_uncertain");
  EXPECT_EQ(GateOf([](PoseOutcome* p) { p->chi2_per_dof = 100; }), "residuals_too_large");
}

// A few keypoints elsewhere are chance; as many as make a pose are a street that repeats itself.
TEST(FailedGate, PosesElsewhereAskForMoreLead) {
  const PoseOptions o;
  const auto gate_of = [](int num_inliers, int num_elsewhere) {
    return GateOf(
        [&](PoseOutcome* p) { p->num_inliers = num_inliers, p->num_elsewhere = num_elsewhere; });
  };
  EXPECT_EQ(gate_of(2 * (o.min_inliers - 1), o.min_inliers - 1), "");
  EXPECT_EQ(gate_of(2 * o.min_inliers, o.min_inliers), "ambiguous_place");
  EXPECT_EQ(gate_of(3 * o.min_inliers, o.min_inliers), "");
}

TEST(IsSure, EachDoubtAsksForTheWholeFrame) {
  const PoseOptions o;
  const auto is_sure = [&](const std::function<void(PoseOutcome*)>& change) {
    PoseOutcome outcome = Sound();
    change(&outcome);
    return IsSure(outcome, o);
  };
  EXPECT_TRUE(is_sure([](PoseOutcome*) {}));
  EXPECT_FALSE(is_sure([](PoseOutcome* p) { p->trusted = false; }));
  EXPECT_FALSE(is_sure([](PoseOutcome* p) { p->degraded = true; }));
  EXPECT_FALSE(is_sure([&](PoseOutcome* p) { p->num_inliers = o.coarse_inliers - 1; }));
  EXPECT_FALSE(is_sure([&](PoseOutcome* p) { p->over_chance = 0.9 * o.coarse_over_chance; }));
  EXPECT_FALSE(is_sure([](PoseOutcome* p) { p->covariance *= 1e4; }));
}

// Brick finds itself in decoy windows too: plenty of landmarks make up for it, few do not.
TEST(FailedGate, PlentyOfLandmarksOutweighsChance) {
  const PoseOptions o;
  const auto near_chance = [&](int num_inliers, double support, double over_chance) {
    return GateOf([&](PoseOutcome* p) {
      p->num_inliers = num_inliers, p->support = support, p->over_chance = over_chance;
    });
  };
  EXPECT_EQ(near_chance(o.plenty_inliers, o.plenty_support, o.plenty_over_chance), "");
  EXPECT_EQ(near_chance(o.plenty_inliers - 1, 0.5, 3), "landmarks_missing");
  EXPECT_EQ(near_chance(200, o.plenty_support - 0.01, 3), "landmarks_missing");
  EXPECT_EQ(near_chance(200, 0.5, o.plenty_over_chance - 0.1), "landmarks_missing");
}

TEST(FailedGate, ACovarianceThatIsNoNumberIsNoCertainty) {
  EXPECT_EQ(GateOf([](PoseOutcome* p) {
              p->covariance.setConstant(std::numeric_limits<double>::quiet_NaN());
            }),
            "pose_uncertain");
}

TEST(FailedGate, PlacesWhereNoVehicleIs) {
  const auto at = [](const Eigen::Vector3d& position) {
    return GateOf([&](PoseOutcome* p) { p->cam_from_local = Street().CamFromLocal(position, 30); });
  };
  EXPECT_EQ(at({5, 20, 2}), "");
  EXPECT_EQ(at({200, 20, 2}), "far_from_map");
  EXPECT_EQ(at({0, 20, 9}), "height_implausible");
  EXPECT_EQ(at({0, 20, -3}), "height_implausible");
}

TEST(FailedGate, AttitudesThatNoVehicleHas) {
  const auto turned = [](double angle_deg, const Eigen::Vector3d& axis_in_cam) {
    return GateOf([&](PoseOutcome* p) {
      const Eigen::Quaterniond turn(Eigen::AngleAxisd(angle_deg * M_PI / 180, axis_in_cam));
      p->cam_from_local = Rigid3(turn, Eigen::Vector3d::Zero()) * p->cam_from_local;
    });
  };
  for (const double angle_deg : {-90.0, 90.0}) {
    EXPECT_EQ(turned(angle_deg, Eigen::Vector3d::UnitY()), "");  // heading is free
    EXPECT_EQ(turned(angle_deg / 10, Eigen::Vector3d::UnitX()), "");
    EXPECT_EQ(turned(angle_deg, Eigen::Vector3d::UnitX()), "tilt_implausible");
    EXPECT_EQ(turned(angle_deg, Eigen::Vector3d::UnitZ()), "tilt_implausible");
  }
}

TEST(DegradeDoubtful, ASoundPoseStaysAFix) {
  PoseOutcome outcome = Sound();
  DegradeDoubtful({}, &outcome);
  EXPECT_FALSE(outcome.degraded);
  EXPECT_EQ(outcome.reason, "");
  EXPECT_EQ(outcome.covariance, Sound().covariance);
}

TEST(DegradeDoubtful, DisagreementWidensTheSigmas) {
  const PoseOptions options;
  PoseOutcome outcome = Sound();
  outcome.agreement = options.fix_agreement / 2;
  outcome.over_chance = options.fix_over_chance + 0.1;
  DegradeDoubtful(options, &outcome);
  EXPECT_TRUE(outcome.degraded);
  EXPECT_EQ(outcome.reason, "landmarks_disagree");
  const double factor = options.degraded_sigma_factor;
  EXPECT_NEAR(outcome.covariance(0, 0), 1e-4 * factor * factor, 1e-9);
}

TEST(DegradeDoubtful, AnUncertainPoseIsNoFix) {
  PoseOutcome outcome = Sound();
  outcome.covariance = Matrix6d::Identity() * 0.3;  // 0.77 m in the plane
  DegradeDoubtful({}, &outcome);
  EXPECT_TRUE(outcome.degraded);
  EXPECT_EQ(outcome.reason, "pose_uncertain");
  EXPECT_EQ(outcome.covariance(0, 0), 0.3);
}

}  // namespace
}  // namespace panofix
