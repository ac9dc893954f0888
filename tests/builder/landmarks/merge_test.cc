#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "builder/landmarks/merge_observations.h"
#include "common/features/matcher.h"
#include "tests/builder/landmarks/observation_kit.h"
#include "tests/builder/landmarks/street.h"

namespace panofix {
namespace {

using ::testing::ElementsAre;

class Merge : public ::testing::Test {
 protected:
  Rng rng_{1, "test/merge"};
  ObservationKit kit_;
  LandmarkOptions options_;
  const Descriptor look_ = RandomDescriptor(&rng_);
  LandmarkLayer Build() { return BuildFromKit(kit_, 1, options_); }
};

TEST_F(Merge, OneTextureElementSeenInManyViewsIsOneLandmark) {
  kit_.Add(7, {0, 5, -2.5F}, look_);
  kit_.Add(3, {0.06F, 5, -2.5F}, Disturbed(look_, 6, &rng_)).angle_deg = 16;
  kit_.Add(5, {0.03F, 5.03F, -2.5F}, Disturbed(look_, 6, &rng_)).size_m = 0.5F;
  const LandmarkLayer layer = Build();
  ASSERT_EQ(layer.landmarks.size(), 1U);
  const Landmark& landmark = layer.landmarks[0];
  EXPECT_THAT(landmark.views, ElementsAre(3, 5, 7));
  EXPECT_TRUE(landmark.point_in_pano.isApprox(Eigen::Vector3f(0.03F, 5.01F, -2.5F), 1e-5F));
  EXPECT_NEAR(landmark.size_m, std::cbrt(0.4 * 0.4 * 0.5), 1e-5);
  EXPECT_NEAR(landmark.angle_deg, 12, 1e-4);
  EXPECT_EQ(landmark.num_panoramas, 1);  // re-rendered: the same evidence
  EXPECT_EQ(landmark.surface_idx, 1);
  // 12 % of the size: the keypoint's own error, however many views show it.
  EXPECT_NEAR(landmark.point_sigma_m, 0.12 * double{landmark.size_m}, 1e-5);
}

TEST_F(Merge, TheMeanDescriptorIsNearerToTheTruthAndOfTheSameLength) {
  constexpr double kNoise = 10;
  for (std::uint32_t v = 0; v < 9; ++v) kit_.Add(v, {0, 5, -2.5F}, Disturbed(look_, kNoise, &rng_));
  const LandmarkLayer layer = Build();
  ASSERT_EQ(layer.landmarks.size(), 1U);
  const Descriptor& mean = layer.landmarks[0].descriptor;
  const int single_sq = DescriptorDistanceSq(look_.data(), Disturbed(look_, kNoise, &rng_).data());
  EXPECT_LT(DescriptorDistanceSq(look_.data(), mean.data()), single_sq / 4);
  const Descriptor zero{};
  EXPECT_NEAR(std::sqrt(DescriptorDistanceSq(zero.data(), mean.data())), 512, 15);  // clipping
}

TEST_F(Merge, WhatDiffersInOneRespectStaysApart) {
  kit_.Add(0, {0, 5, -2.5F}, look_);
  kit_.Add(1, {0.12F, 5, -2.5F}, look_);                // farther than a quarter of the size
  kit_.Add(2, {0, 5, -2.5F}, look_).size_m = 0.6F;      // half as big again
  kit_.Add(3, {0, 5, -2.5F}, look_).angle_deg = 35;     // turned
  kit_.Add(4, {0, 5, -2.5F}, RandomDescriptor(&rng_));  // another look: its own landmark
  kit_.Add(5, {0, 5, -2.5F}, look_).surface_idx = 2;    // another plane
  EXPECT_EQ(Build().landmarks.size(), 6U);
}

TEST_F(Merge, AnglesMeetAcrossNorth) {
  kit_.Add(0, {0, 5, -2.5F}, look_).angle_deg = 356;
  kit_.Add(1, {0, 5, -2.5F}, look_).angle_deg = 8;
  const LandmarkLayer layer = Build();
  ASSERT_EQ(layer.landmarks.size(), 1U);
  EXPECT_NEAR(layer.landmarks[0].angle_deg, 2, 1e-4);
}

TEST_F(Merge, AViewIsListedOnce) {
  for (int k = 0; k < 3; ++k) kit_.Add(4, {0, 5, -2.5F}, look_);
  const LandmarkLayer layer = Build();
  ASSERT_EQ(layer.landmarks.size(), 1U);
  EXPECT_THAT(layer.landmarks[0].views, ElementsAre(4));
}

// Every joined pair agrees with the rules, checked against all others by brute force.
TEST_F(Merge, NoLeaderCouldHaveJoinedAnEarlierOne) {
  constexpr int kNum = 400;
  for (std::uint32_t i = 0; i < kNum; ++i) {
    const Eigen::Vector3f point(static_cast<float>(rng_.Uniform(-1, 1)),
                                static_cast<float>(rng_.Uniform(-1, 1)), -2.5F);
    LandmarkObservation& o = kit_.Add(i, point, look_);
    o.size_m = static_cast<float>(std::exp(rng_.Uniform(-3, 0)));
    o.angle_deg = 0;
  }
  const auto observations = kit_.observations();
  // Leader clustering in order of the views; equal looks, so the first fitting leader wins.
  std::vector<const LandmarkObservation*> leaders;
  std::vector<int> sizes;
  for (const LandmarkObservation& o : observations) {
    const auto fits = [&](const LandmarkObservation* l) {
      const float small = std::min(l->size_m, o.size_m), big = std::max(l->size_m, o.size_m);
      return double{big} < 1.4 * double{small} &&
             double{(l->point_in_pano - o.point_in_pano).norm()} < 0.25 * double{small};
    };
    const auto leader = std::find_if(leaders.begin(), leaders.end(), fits);
    if (leader == leaders.end()) {
      leaders.push_back(&o), sizes.push_back(1);
    } else {
      ++sizes[static_cast<std::size_t>(leader - leaders.begin())];
    }
  }
  options_.max_per_view = 0;
  const LandmarkLayer layer = Build();
  ASSERT_EQ(layer.landmarks.size(), leaders.size());
  for (std::size_t i = 0; i < leaders.size(); ++i) {
    EXPECT_EQ(layer.landmarks[i].views.size(), static_cast<std::size_t>(sizes[i]));
    EXPECT_EQ(layer.landmarks[i].views.front(), leaders[i]->view);
  }
}

TEST_F(Merge, OffEveryObservationIsALandmarkUnchanged) {
  for (std::uint32_t v = 0; v < 3; ++v) kit_.Add(2 - v, {0, 5, -2.5F}, look_);
  options_.merge = false;
  const LandmarkLayer layer = Build();
  ASSERT_EQ(layer.landmarks.size(), 3U);
  for (std::uint32_t v = 0; v < 3; ++v) {
    EXPECT_THAT(layer.landmarks[v].views, ElementsAre(v));
    EXPECT_EQ(layer.landmarks[v].point_in_pano, Eigen::Vector3f(0, 5, -2.5F));
    EXPECT_EQ(layer.landmarks[v].descriptor, look_);
    EXPECT_FLOAT_EQ(layer.landmarks[v].range_sigma_m, 0.2F);
  }
  EXPECT_EQ(layer.panoramas.size(), 1U);
}

TEST_F(Merge, WhatIsNotFiniteIsDropped) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kInf = std::numeric_limits<float>::infinity();
  kit_.Add(0, {kNan, 5, -2.5F}, look_);
  kit_.Add(1, {0, kInf, -2.5F}, look_);
  kit_.Add(2, {0, 0, 0}, look_);
  kit_.Add(3, {0, 5, -2.5F}, look_).range_sigma_m = kNan;
  kit_.Add(4, {0, 5, -2.5F}, look_).size_m = 0;
  kit_.Add(5, {0, 5, -2.5F}, look_).size_m = kInf;
  kit_.Add(6, {0, 5, -2.5F}, look_).angle_deg = kNan;
  kit_.Add(7, {0, 5, -2.5F}, look_).response = kNan;
  kit_.Add(8, {1e30F, 5, -2.5F}, look_);
  kit_.Add(9, {0, 5, -2.5F}, look_);
  const LandmarkLayer layer = Build();
  ASSERT_EQ(layer.landmarks.size(), 1U);
  EXPECT_THAT(layer.landmarks[0].views, ElementsAre(9));
}

TEST_F(Merge, AnUnknownPanoramaIsTheCallersFault) {
  kit_.Add(0, {0, 5, -2.5F}, look_).panorama = 1;
  EXPECT_THROW((void)Build(), std::logic_error);
}

}  // namespace
}  // namespace panofix
