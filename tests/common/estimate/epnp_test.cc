#include <gtest/gtest.h>

#include <limits>

#include "common/estimate/pnp.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_pose.h"

namespace panofix {
namespace {

// EPnP solves a linearised problem; on exact data it leaves far less than a millimetre.
constexpr double kTolerance_rad = 1e-5;
constexpr double kTolerance_m = 1e-3;

TEST(SolveEpnp, ExactDataGivesTheTruth) {
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    SyntheticPoseOptions options;
    options.num_matches = 20;
    const SyntheticPose world = MakeSyntheticPose(options, seed);
    Rigid3 pose;
    ASSERT_TRUE(SolveEpnp(world.matches, &pose));
    EXPECT_THAT(pose.Inverse(),
                Rigid3Near(world.cam_from_map.Inverse(), kTolerance_rad, kTolerance_m));
  }
}

TEST(SolveEpnp, FewerThanFourMatchesFail) {
  const SyntheticPose world = MakeSyntheticPose({}, 1);
  Rigid3 pose;
  for (std::size_t count = 0; count < 4; ++count) {
    EXPECT_FALSE(SolveEpnp(std::span(world.matches).first(count), &pose));
  }
}

TEST(SolveEpnp, HostileMatchesFailOrAreFinite) {
  SyntheticPoseOptions options;
  options.num_matches = 6;
  SyntheticPose world = MakeSyntheticPose(options, 2);
  Rigid3 pose;
  auto same = world.matches;
  for (Correspondence& match : same) match = same[0];
  if (SolveEpnp(same, &pose)) {
    EXPECT_TRUE(pose.translation.allFinite());
  }
  world.matches[3].point_in_map.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(SolveEpnp(world.matches, &pose));
  world.matches[3].point_in_map.x() = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(SolveEpnp(world.matches, &pose));
}

}  // namespace
}  // namespace panofix
