#include "runtime/retrieval/landmark_votes.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/runtime/pose/synthetic_street.h"

namespace panofix {
namespace {

std::vector<float> Score(const FrameFeatures& frame, const std::vector<char>& wanted = {}) {
  const MapBundle& bundle = *Street().bundle();
  const Voters voters(bundle.vocabulary(), frame.sift, frame.bearings, Street().camera(), {});
  std::vector<float> scores(bundle.views().size(), 0);
  for (std::size_t tile = 0; tile < bundle.tiles().size(); ++tile) {
    const TileVotes votes(bundle, tile, WordsOfLandmarks(bundle, tile),
                          LocalFrame::At(bundle.panoramas().front()), {});
    votes.Score(voters, wanted, &scores);
  }
  return scores;
}

std::size_t BestOf(const std::vector<float>& scores) {
  return static_cast<std::size_t>(std::max_element(scores.begin(), scores.end()) - scores.begin());
}

TEST(LandmarkVotes, TheViewThatLooksAlongWins) {
  const MapBundle& bundle = *Street().bundle();
  for (std::uint32_t s = 0; s < bundle.stations().size(); ++s) {
    const Eigen::Vector3d station_in_local =
        Street().local().FromMap(Street().stations().position_in_map(s));
    for (const double heading_deg : {10.0, 170.0}) {
      Rigid3 pose = Street().CamFromLocal({0.5, 8.0 * (s / 2) + 4.0 * (s % 2), 1.6}, heading_deg);
      const auto scores = Score(Street().Frame(pose, 0.5, 100));
      const MapView& best = bundle.views()[BestOf(scores)];
      const Eigen::Vector3d best_in_local =
          Street().local().FromMap(Street().stations().position_in_map(best.station_idx));
      // The walls are seen alike from the next stations.
      EXPECT_LT((best_in_local - station_in_local).norm(), 9) << s << " " << heading_deg;
      const Rigid3 view_pose =
          PoseOfView(bundle, Street().local(), static_cast<std::uint32_t>(BestOf(scores)));
      EXPECT_LT(AngleBetween(view_pose.rotation, pose.rotation), 0.6) << s << " " << heading_deg;
    }
  }
}

TEST(LandmarkVotes, OnlyWantedViewsAreScored) {
  const FrameFeatures frame = Street().Frame(Street().CamFromLocal({0.5, 14, 1.6}, 5), 0.5, 50);
  const std::vector<float> all = Score(frame);
  std::vector<char> wanted(all.size(), 0);
  for (std::size_t v = 0; v < wanted.size(); v += 3) wanted[v] = 1;
  const std::vector<float> some = Score(frame, wanted);
  for (std::size_t v = 0; v < all.size(); ++v)
    EXPECT_FLOAT_EQ(some[v], wanted[v] != 0 ? all[v] : 0.0F) << v;
}

TEST(LandmarkVotes, StrangersGatherLittle) {
  const FrameFeatures known = Street().Frame(Street().CamFromLocal({0.5, 14, 1.6}, 5), 0.5, 0);
  // Far beyond the walls there is nothing to see but clutter.
  const FrameFeatures clutter = Street().Frame(Street().CamFromLocal({0.5, 500, 1.6}, 5), 0.5, 300);
  const auto most = [](const std::vector<float>& scores) {
    return *std::max_element(scores.begin(), scores.end());
  };
  EXPECT_LT(most(Score(clutter)), 0.1F * most(Score(known)));
}

TEST(LandmarkVotes, AnEmptyFrameScoresNothing) {
  const std::vector<float> scores = Score({});
  EXPECT_EQ(*std::max_element(scores.begin(), scores.end()), 0.0F);
}

}  // namespace
}  // namespace panofix
