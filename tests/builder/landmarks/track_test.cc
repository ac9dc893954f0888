#include <gtest/gtest.h>

#include "builder/landmarks/match_tracks.h"
#include "builder/landmarks/merge_observations.h"
#include "tests/builder/landmarks/observation_kit.h"
#include "tests/builder/landmarks/street.h"

namespace panofix {
namespace {

TEST(JoinTracks, ChainsBecomeOneTrack) {
  const auto tracks =
      JoinTracks({{{0, 4}, {1, 7}, 100}, {{1, 7}, {2, 1}, 200}, {{0, 5}, {2, 9}, 50}});
  ASSERT_EQ(tracks.size(), 2U);
  EXPECT_EQ(tracks[0].members, (std::vector<LandmarkRef>{{0, 4}, {1, 7}, {2, 1}}));
  EXPECT_EQ(tracks[1].members, (std::vector<LandmarkRef>{{0, 5}, {2, 9}}));
}

TEST(JoinTracks, AContradictionGoesToTheMoreAlike) {
  // 0/4 and 0/5 both reach 2/1: the chain over panorama 1 is the weaker one.
  const auto tracks =
      JoinTracks({{{0, 4}, {1, 7}, 100}, {{1, 7}, {2, 1}, 300}, {{0, 5}, {2, 1}, 200}});
  ASSERT_EQ(tracks.size(), 2U);
  EXPECT_EQ(tracks[0].members, (std::vector<LandmarkRef>{{0, 4}, {1, 7}}));
  EXPECT_EQ(tracks[1].members, (std::vector<LandmarkRef>{{0, 5}, {2, 1}}));
}

TEST(JoinTracks, NothingFromNothing) { EXPECT_TRUE(JoinTracks({}).empty()); }

// Counts right and wrong matches on a street whose truth is known.
TEST(MatchLandmarks, FindsMostOfWhatIsThereAndNothingElse) {
  StreetOptions options;
  const Street street = MakeStreet(options, 3);
  const LayerInput input{street.panoramas, street.errors, street.focal_px, {}};
  const MergedLandmarks merged = MergeObservations(input, street.observations);
  const auto matches = MatchLandmarks(input, merged, std::vector<bool>(merged.size(), false));
  int wrong = 0;
  for (const TrackMatch& m : matches) {
    wrong += PointOf(street, Get(merged, m.a)) != PointOf(street, Get(merged, m.b));
  }
  EXPECT_EQ(wrong, 0);
  std::map<std::size_t, int> seen_by;
  for (const auto& some : merged) {
    for (const MergedLandmark& m : some) ++seen_by[PointOf(street, m.landmark)];
  }
  std::size_t possible = 0;
  for (const auto& [point, n] : seen_by) possible += static_cast<std::size_t>(n * (n - 1) / 2);
  // The gates are at 3 sigma of capped errors; far, oblique ground falls outside.
  EXPECT_GT(matches.size(), possible / 2);
}

TEST(MatchLandmarks, RepeatedTextureIsNotMatched) {
  Rng rng(2, "test/tracks");
  const Descriptor look = RandomDescriptor(&rng);
  ObservationKit kit;
  // The same look every 0.5 m: which is which nobody can say.
  for (std::uint32_t p = 0; p < 2; ++p) {
    for (int k = 0; k < 9; ++k) {
      LandmarkObservation& o = kit.Add(
          p, {2.5F - 5.0F * static_cast<float>(p) + 0.3F * static_cast<float>(k), 10, 1}, look);
      o.panorama = p, o.surface_idx = 2, o.size_m = 0.2F;
    }
  }
  const LandmarkLayer layer = BuildFromKit(kit, 2, {});
  for (const Landmark& landmark : layer.landmarks) EXPECT_EQ(landmark.num_panoramas, 1);
}

class TwoSights : public ::testing::Test {
 protected:
  // One point of the wall, seen by panoramas 5 m apart with the looks given.
  static LandmarkLayer Build(const Descriptor& a, const Descriptor& b) {
    ObservationKit kit;
    for (std::uint32_t p = 0; p < 2; ++p) {
      LandmarkObservation& o = kit.Add(p + 1, {p == 0 ? 2.5F : -2.5F, 10, 1}, p == 0 ? a : b);
      o.panorama = p, o.surface_idx = 2;
    }
    return BuildFromKit(kit, 2, {});
  }
  Rng rng_{5, "test/two"};
  const Descriptor look_ = RandomDescriptor(&rng_);
};

TEST_F(TwoSights, OfOneLookAreOneLandmark) {
  const LandmarkLayer layer = Build(look_, Disturbed(look_, 6, &rng_));
  ASSERT_EQ(layer.landmarks.size(), 1U);
  const Landmark& landmark = layer.landmarks[0];
  EXPECT_EQ(landmark.num_panoramas, 2);
  EXPECT_EQ(landmark.surface_idx, 0);
  EXPECT_EQ(landmark.views, (std::vector<std::uint32_t>{1, 2}));
  EXPECT_LT(landmark.range_sigma_m, 0.2F);  // better than either panorama's own
  EXPECT_LT(landmark.point_sigma_m, 0.12F * 0.4F);
}

TEST_F(TwoSights, OfTwoLooksAreTwoLandmarksAtOnePoint) {
  Descriptor other = look_;  // 20 sqrt(128) = 226 away: beyond merging, within matching
  for (std::uint8_t& value : other) {
    value = static_cast<std::uint8_t>(value < 128 ? value + 20 : value - 20);
  }
  const LandmarkLayer layer = Build(look_, other);
  ASSERT_EQ(layer.landmarks.size(), 2U);
  EXPECT_EQ(layer.landmarks[0].point_in_pano, layer.landmarks[1].point_in_pano);
  EXPECT_EQ(layer.landmarks[0].panorama, layer.landmarks[1].panorama);
  for (const Landmark& landmark : layer.landmarks) {
    EXPECT_EQ(landmark.num_panoramas, 2);
    EXPECT_EQ(landmark.views.size(), 1U);
  }
}

TEST_F(TwoSights, OfUnrelatedLooksStayWithTheirPanoramas) {
  const LandmarkLayer layer = Build(look_, RandomDescriptor(&rng_));
  ASSERT_EQ(layer.landmarks.size(), 2U);
  EXPECT_NE(layer.landmarks[0].panorama, layer.landmarks[1].panorama);
  for (const Landmark& landmark : layer.landmarks) EXPECT_EQ(landmark.surface_idx, 2);
}

}  // namespace
}  // namespace panofix
