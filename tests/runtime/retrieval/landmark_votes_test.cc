#include "runtime/retrieval/landmark_votes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "common/geometry/attitude.h"
#include "common/map/landmark_codes.h"
#include "runtime/retrieval/retrieval.h"
#include "tests/runtime/pose/synthetic_street.h"

namespace panofix {
namespace {

std::vector<float> Score(const FrameFeatures& frame, const std::vector<char>& wanted = {}) {
  const MapBundle& bundle = *Street().bundle();
  const Voters voters(bundle.vocabulary(), frame.sift, frame.bearings, Street().camera(), {});
  std::vector<float> scores(bundle.views().size(), 0);
  for (std::size_t tile = 0; tile < bundle.tiles().size(); ++tile) {
    const std::vector<std::uint32_t> words =
        bundle.tiles().Get(tile).DeriveWords(bundle.vocabulary().sift);
    const TileVotes votes(bundle, tile, words, LocalFrame::At(bundle.panoramas().front()), {});
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

TEST(LandmarkVotes, OrientationsThatMayVoteAreThoseWithinTheTurn) {
  const MapBundle& bundle = *Street().bundle();
  FrameFeatures frame = Street().Frame(Street().CamFromLocal({0.5, 14, 1.6}, 5), 0.5, 0);
  Rng rng(1, "tests/angles");
  for (Keypoint& k : frame.sift.keypoints) k.angle_deg = static_cast<float>(rng.Uniform(0, 360));
  frame.sift.keypoints[0].angle_deg = 0, frame.sift.keypoints[1].angle_deg = 359.9F;
  for (const double max_turn_deg : {0.0, 25.0, 45.0, 179.9, 180.0}) {
    VoteOptions options;
    options.max_turn_deg = max_turn_deg;
    const Voters voters(bundle.vocabulary(), frame.sift, frame.bearings, Street().camera(),
                        options);
    for (std::size_t k = 0; k < frame.sift.size(); ++k) {
      for (int code = 0; code < 256; ++code) {
        const double turn_deg = AngleDifferenceDeg(double{frame.sift.keypoints[k].angle_deg},
                                                   DecodeAngle(static_cast<std::uint8_t>(code)));
        const auto place = static_cast<std::uint8_t>(code - voters.angles[k].first);
        ASSERT_EQ(place < voters.angles[k].count, std::abs(turn_deg) <= max_turn_deg)
            << frame.sift.keypoints[k].angle_deg << " " << code;
      }
    }
  }
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

// What retrieval makes of a frame in the street's bundle.
std::vector<float> VotesIn(const SyntheticStreet& street, const FrameFeatures& frame) {
  return Retrieval(street.bundle(), {}).Votes(frame.sift, frame.bearings, street.camera());
}

TEST(LandmarkVotes, ASearchOfTheWholeMapCountsThemToo) {
  const MapBundle& bundle = *Street().bundle();
  const FrameFeatures frame = Street().Frame(Street().CamFromLocal({0.5, 14, 1.6}, 5), 0.5, 50);
  const BagOfWords bag = bundle.vocabulary().Bag(bundle.vocabulary().SiftWords(frame.sift), {});
  bool is_over = false;
  const RetrievalQuery query{bag, frame.sift, frame.bearings, Street().camera(),
                             [&] { return is_over; }};
  const Retrieval retrieval(Street().bundle(), {});
  EXPECT_EQ(retrieval.Global(query).votes, VotesIn(Street(), frame));
  RetrievalOptions words_alone;
  words_alone.use_landmarks = false;
  EXPECT_TRUE(Retrieval(Street().bundle(), words_alone).Global(query).votes.empty());
  is_over = true;
  EXPECT_TRUE(retrieval.Global(query).votes.empty());
}

TEST(LandmarkVotes, StoredWordsVoteAsDerivedOnes) {
  const SyntheticStreet stored(StreetShape::kTwoWalls, 600,
                               [](CraftedBundle* bundle) { bundle->AddWords(); });
  ASSERT_TRUE(Street().bundle()->tiles().Get(0).words().empty());
  ASSERT_EQ(stored.bundle()->tiles().Get(0).words().size(), stored.bundle()->num_landmarks());
  const FrameFeatures frame = Street().Frame(Street().CamFromLocal({0.5, 14, 1.6}, 5), 0.5, 50);
  const std::vector<float> expected = VotesIn(Street(), frame);
  EXPECT_GT(*std::max_element(expected.begin(), expected.end()), 1.0F);
  EXPECT_EQ(VotesIn(stored, frame), expected);
  // They are used: wrong ones are looked up in vain.
  const SyntheticStreet wrong(StreetShape::kTwoWalls, 600, [](CraftedBundle* bundle) {
    bundle->AddWords();
    for (std::uint32_t& word : *bundle->tiles[0].landmark_words) word = 0;
  });
  EXPECT_NE(VotesIn(wrong, frame), expected);
}

TEST(LandmarkVotes, AnEmptyFrameScoresNothing) {
  const std::vector<float> scores = Score({});
  EXPECT_EQ(*std::max_element(scores.begin(), scores.end()), 0.0F);
}

}  // namespace
}  // namespace panofix
