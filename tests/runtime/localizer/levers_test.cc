#include "runtime/localizer/levers.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stdexcept>

#include "runtime/localizer/estimator_options.h"
#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"

namespace panofix {
namespace {

using testing::HasSubstr;

std::string FaultOf(const std::string& preset, const std::vector<std::string>& add) {
  try {
    (void)ResolveLevers(preset, add);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(ResolveLevers, PresetsAreTheEndsOfTheLadder) {
  const Levers paper = ResolveLevers("paper", {}), all = ResolveLevers("default", {});
  EXPECT_FALSE(paper.mutual || paper.ranked || paper.pooled || paper.sigmas || paper.gates ||
               paper.votes || paper.guided || paper.tracking || paper.bridging || paper.coarse ||
               paper.confirm || paper.exhaustive);
  EXPECT_TRUE(all.mutual && all.ranked && all.pooled && all.sigmas && all.gates && all.votes &&
              all.guided && all.tracking && all.bridging && all.coarse && all.confirm);
  EXPECT_FALSE(all.exhaustive);
}

TEST(ResolveLevers, AddsWhatIsNamed) {
  const Levers levers = ResolveLevers("paper", {"pooled", "gates"});
  EXPECT_TRUE(levers.pooled && levers.gates);
  EXPECT_FALSE(levers.mutual || levers.sigmas || levers.guided);
  EXPECT_TRUE(ResolveLevers("default", {"exhaustive"}).exhaustive);
}

TEST(ResolveLevers, FaultsNameTheLever) {
  EXPECT_THAT(FaultOf("papre", {}), HasSubstr("papre"));
  EXPECT_THAT(FaultOf("paper", {"pooled", "poled"}), HasSubstr("'poled'"));
  EXPECT_THAT(FaultOf("paper", {""}), HasSubstr("tracking"));  // the list of those there are
  EXPECT_THAT(FaultOf("paper", {"gates"}), HasSubstr("'pooled'"));
  EXPECT_THAT(FaultOf("paper", {"pooled", "gates", "guided"}), HasSubstr("'sigmas'"));
  EXPECT_THAT(FaultOf("paper", {"tracking"}), HasSubstr("'ranked'"));
  EXPECT_EQ(FaultOf("paper", {"pooled", "sigmas", "gates", "guided"}), "");
}

TEST(LeverHelp, NamesEveryLever) {
  for (const char* name : {"mutual", "ranked", "pooled", "sigmas", "gates", "votes", "guided",
                           "tracking", "bridging", "coarse", "exhaustive"}) {
    EXPECT_THAT(LeverHelp(), HasSubstr(std::string("  ") + name + ": "));
    if (std::string(name) == "guided" || std::string(name) == "tracking" ||
        std::string(name) == "bridging" || std::string(name) == "coarse" ||
        std::string(name) == "gates") {
      continue;  // stand on others
    }
    EXPECT_EQ(FaultOf("paper", {name}), "");
  }
}

TEST(EstimatorOptions, FollowTheLevers) {
  const TempFolder folder;
  SmallBundle().Write(folder / "b");
  const auto bundle = ValueOrThrow(MapBundle::Open(folder / "b"));
  const Camera& camera = bundle->manifest().camera;
  const Levers paper = ResolveLevers("paper", {}), all = ResolveLevers("default", {});

  const PaperOptions letter = PaperOptionsFor(paper, camera, 1);
  EXPECT_EQ(letter.ransac.minimal_solver, MinimalSolver::kEpnp);
  EXPECT_EQ(letter.ransac.max_reproj_error_px, 3.0);
  EXPECT_EQ(letter.min_inliers, 13);  // "larger than 12"
  EXPECT_TRUE(letter.use_kvld);
  EXPECT_FALSE(letter.use_sigmas || letter.refine.use_point_sigma || letter.match.mutual);
  EXPECT_FALSE(PaperOptionsFor(all, camera, 1).use_kvld);
  EXPECT_FALSE(RetrievalOptionsFor(paper, *bundle, 0).use_landmarks);
  EXPECT_TRUE(RetrievalOptionsFor(all, *bundle, 0).use_landmarks);

  const PoseOptions ours = PoseOptionsFor(all, *bundle, camera, 1), given;
  EXPECT_TRUE(ours.use_guided);
  EXPECT_EQ(ours.min_inliers, given.min_inliers);
  EXPECT_EQ(ours.max_tilt_deg, given.max_tilt_deg);
  const PoseOptions open = PoseOptionsFor(ResolveLevers("paper", {"pooled"}), *bundle, camera, 1);
  EXPECT_FALSE(open.use_guided || open.refine.use_point_sigma);
  EXPECT_EQ(open.min_inliers, 13);
  EXPECT_GT(open.max_tilt_deg, 180);
  EXPECT_EQ(open.min_lead + open.min_clear_lead, 0);
}

}  // namespace
}  // namespace panofix
