#include "common/features/kvld.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numeric>

#include "common/base/rng.h"
#include "tests/common/features/synthetic_image.h"

namespace panofix {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr int kWidth = 320, kHeight = 240;

// `count` keypoints on a jittered grid, at least 12 px apart, upright.
std::vector<Keypoint> Spread(int count, Rng* rng) {
  std::vector<Keypoint> keypoints;
  for (int i = 0; i < count; ++i) {
    const int column = i % 15, row = i / 15;
    keypoints.push_back({static_cast<float>(20 + 20 * column + rng->Uniform(-4, 4)),
                         static_cast<float>(20 + 20 * row + rng->Uniform(-4, 4)), 8, 0, 1});
  }
  return keypoints;
}

std::vector<FeatureMatch> Identity(std::size_t count) {
  std::vector<FeatureMatch> matches(count);
  for (std::size_t i = 0; i < count; ++i) {
    matches[i].query_idx = matches[i].database_idx = static_cast<int>(i);
  }
  return matches;
}

std::vector<int> AllOf(std::size_t count) {
  std::vector<int> all(count);
  std::iota(all.begin(), all.end(), 0);
  return all;
}

class Kvld : public ::testing::Test {
 protected:
  std::vector<int> Filter(std::span<const FeatureMatch> matches) const {
    return FilterKvld(image_, keypoints_, image_, keypoints_, matches, {});
  }
  Rng rng_{1, "tests/kvld"};
  GradientPyramid image_{BusyImage(kWidth, kHeight, 4)};
  std::vector<Keypoint> keypoints_ = Spread(150, &rng_);
};

TEST_F(Kvld, KeepsIdentity) { EXPECT_EQ(Filter(Identity(150)), AllOf(150)); }

TEST_F(Kvld, KeepsTurnedAndShrunk) {
  // By 90 degrees clockwise, and every 2 x 2 pixels one: (x, y) goes to (h - 1 - y, x) / 2.
  const GrayImage whole = BusyImage(kWidth, kHeight, 4);
  GrayImage half{kHeight / 2, kWidth / 2, {}};
  for (int y = 0; y < half.height_px; ++y) {
    for (int x = 0; x < half.width_px; ++x) {
      int sum = 2;
      for (const auto& [dx, dy] : {std::pair{0, 0}, {0, 1}, {1, 0}, {1, 1}}) {
        const int from_x = 2 * y + dy, from_y = kHeight - 1 - (2 * x + dx);
        sum += whole.pixels[static_cast<std::size_t>(from_y * kWidth + from_x)];
      }
      half.pixels.push_back(static_cast<std::uint8_t>(sum / 4));
    }
  }
  std::vector<Keypoint> turned = keypoints_;
  for (Keypoint& k : turned) {
    k = {(kHeight - 1 - k.y_px - 0.5F) / 2, (k.x_px - 0.5F) / 2, k.size_px / 2, 90, 1};
  }
  const GradientPyramid half_image(half);
  const auto matches = Identity(150);
  EXPECT_EQ(FilterKvld(image_, keypoints_, half_image, turned, matches, {}).size(), 150U);
  // 40 degrees off: every neighbour is contradicted, though all lines match.
  for (Keypoint& k : turned) k.angle_deg = 50;
  EXPECT_THAT(FilterKvld(image_, keypoints_, half_image, turned, matches, {}), IsEmpty());
}

TEST_F(Kvld, DropsRandomMatches) {
  std::vector<FeatureMatch> matches = Identity(150);
  for (FeatureMatch& m : matches) m.database_idx = static_cast<int>(rng_.Below(150));
  EXPECT_LE(Filter(matches).size(), 3U);  // as many as chance paired rightly: one is expected
}

TEST_F(Kvld, PicksTheRightOnesAmongRandomOnes) {
  std::vector<FeatureMatch> matches = Identity(150);
  for (int i = 0; i < 150; ++i) {
    if (i % 3 != 0) matches[static_cast<std::size_t>(i)].database_idx = (i * 37 + 11) % 150;
  }
  int num_right = 0, num_wrong = 0;
  for (const int i : Filter(matches)) {
    const FeatureMatch& m = matches[static_cast<std::size_t>(i)];
    ++(m.query_idx == m.database_idx ? num_right : num_wrong);
  }
  EXPECT_GE(num_right, 48);  // of 50
  EXPECT_LE(num_wrong, 3);   // of 100, by chance beside their right place
}

TEST_F(Kvld, OtherImageKeepsNothing) {
  const GradientPyramid other(BusyImage(kWidth, kHeight, 5));
  // Geometry agrees everywhere: the lines alone decide, each with a small chance to match.
  EXPECT_LE(FilterKvld(image_, keypoints_, other, keypoints_, Identity(150), {}).size(), 15U);
}

TEST_F(Kvld, OfCompetitorsTheRightOneStays) {
  std::vector<FeatureMatch> matches = Identity(150);
  for (int i = 0; i < 150; ++i) {
    matches.push_back({i, (i + 1) % 150, 0});  // next door: consistent with many
  }
  const std::vector<int> kept = Filter(matches);
  std::vector<int> query_uses(150), database_uses(150);
  int num_right = 0;
  for (const int i : kept) {
    const FeatureMatch& m = matches[static_cast<std::size_t>(i)];
    EXPECT_EQ(++query_uses[static_cast<std::size_t>(m.query_idx)], 1);
    EXPECT_EQ(++database_uses[static_cast<std::size_t>(m.database_idx)], 1);
    num_right += m.query_idx == m.database_idx;
  }
  EXPECT_GE(num_right, 145);
}

TEST_F(Kvld, OfCompetitorsThatAllAgreeTheBestStays) {
  std::vector<Keypoint> database = keypoints_;
  for (Keypoint k : keypoints_) {
    k.x_px += 2;
    database.push_back(k);
  }
  std::vector<FeatureMatch> matches = Identity(150), shifted = Identity(150);
  for (FeatureMatch& m : shifted) m.database_idx += 150;
  EXPECT_GE(FilterKvld(image_, keypoints_, image_, database, shifted, {}).size(), 140U);
  matches.insert(matches.end(), shifted.begin(), shifted.end());
  EXPECT_EQ(FilterKvld(image_, keypoints_, image_, database, matches, {}), AllOf(150));
}

TEST_F(Kvld, AGroupThatItsSurroundingsContradictIsDropped) {
  // A patch with 9 keypoints is there twice; they are matched to its copy.
  GrayImage image = BusyImage(kWidth, kHeight, 4);
  const auto pixel = [&](int x, int y) -> std::uint8_t& {
    return image.pixels[static_cast<std::size_t>(y * kWidth + x)];
  };
  for (int y = 40; y < 130; ++y) {
    for (int x = 40; x < 130; ++x) pixel(x + 150, y + 60) = pixel(x, y);
  }
  const GradientPyramid twice(image);
  std::vector<Keypoint> query = keypoints_, database = keypoints_;
  std::vector<FeatureMatch> matches = Identity(159), group;
  for (int i = 0; i < 9; ++i) {
    const float x_px = static_cast<float>(57 + 20 * (i % 3) + i);
    const float y_px = static_cast<float>(63 + 20 * (i / 3) - i);
    query.push_back({x_px, y_px, 8, 0, 1});
    database.push_back({x_px + 150, y_px + 60, 8, 0, 1});
    group.push_back({150 + i, 150 + i, 0});
  }
  EXPECT_EQ(FilterKvld(twice, query, twice, database, group, {}), AllOf(9));
  EXPECT_EQ(FilterKvld(twice, query, twice, database, matches, {}), AllOf(150));
}

TEST_F(Kvld, WidensNeighbourhoodsWhileTooFewAreKept) {
  KvldOptions options;
  options.inlier_rate = 1;  // circles of 22 px, where few points have 3 neighbours
  EXPECT_GE(FilterKvld(image_, keypoints_, image_, keypoints_, Identity(150), options).size(), 75U);
}

TEST_F(Kvld, KeypointsOfSeveralOrientationsAreNoCompetitors) {
  std::vector<Keypoint> twice = keypoints_;
  for (const Keypoint& k : keypoints_) {
    twice.push_back(k);
    twice.back().angle_deg = 120;
  }
  const auto matches = Identity(300);
  EXPECT_EQ(FilterKvld(image_, twice, image_, twice, matches, {}).size(), 300U);
}

TEST_F(Kvld, FewerThanKNeighboursAreNotEnough) {
  EXPECT_THAT(Filter({}), IsEmpty());
  for (std::size_t count = 1; count <= 3; ++count) EXPECT_THAT(Filter(Identity(count)), IsEmpty());
  EXPECT_THAT(Filter(Identity(4)), ElementsAre(0, 1, 2, 3));
}

TEST_F(Kvld, RepeatedMatchesCountOnceAndTheFirstIsReturned) {
  std::vector<FeatureMatch> matches = Identity(3);
  for (int i = 0; i < 3; ++i) matches.push_back(matches[static_cast<std::size_t>(i)]);
  EXPECT_THAT(Filter(matches), IsEmpty());  // 3 different ones have 2 neighbours each
  matches = Identity(150);
  matches.insert(matches.end(), matches.begin(), matches.begin() + 150);
  EXPECT_EQ(Filter(matches), AllOf(150));
}

TEST_F(Kvld, OneKeypointOverAndOverSupportsNothing) {
  const std::vector<Keypoint> same(100, keypoints_[0]);
  EXPECT_THAT(FilterKvld(image_, same, image_, same, Identity(100), {}), IsEmpty());
  std::vector<FeatureMatch> fan = Identity(150);  // all to one
  for (FeatureMatch& m : fan) m.database_idx = 0;
  EXPECT_THAT(Filter(fan), IsEmpty());
}

TEST_F(Kvld, BorderAndOutsideAreNoTrouble) {
  std::vector<Keypoint> border;
  for (int i = 0; i < 16; ++i) {
    border.push_back({static_cast<float>(i * (kWidth - 1) / 15.0), 0, 8, 0, 1});
    border.push_back({static_cast<float>(i * (kWidth - 1) / 15.0), kHeight - 1, 8, 0, 1});
  }
  EXPECT_GE(FilterKvld(image_, border, image_, border, Identity(32), {}).size(), 30U);
  for (Keypoint& k : border) k.y_px += 5000;
  EXPECT_THAT(FilterKvld(image_, border, image_, border, Identity(32), {}), IsEmpty());
}

TEST_F(Kvld, KeepsTheSameInAnyOrder) {
  std::vector<Keypoint> database = keypoints_;  // each there twice: equally good partners
  database.insert(database.end(), keypoints_.begin(), keypoints_.end());
  std::vector<FeatureMatch> matches = Identity(150);
  for (int i = 0; i < 150; ++i) {
    matches.push_back({i, 150 + i, 0});
    matches.push_back({i, static_cast<int>(rng_.Below(300)), 0});
    if (i % 2 == 0) matches.push_back({i, (i + 1) % 150, 0});
  }
  const auto pairs_of = [&](const std::vector<FeatureMatch>& from) {
    std::vector<std::pair<int, int>> pairs;
    for (const int i : FilterKvld(image_, keypoints_, image_, database, from, {})) {
      const FeatureMatch& m = from[static_cast<std::size_t>(i)];
      pairs.emplace_back(m.query_idx, m.database_idx);
    }
    std::sort(pairs.begin(), pairs.end());
    return pairs;
  };
  const auto expected = pairs_of(matches);
  ASSERT_GT(expected.size(), 100U);
  for (int trial = 0; trial < 3; ++trial) {
    for (std::size_t i = matches.size() - 1; i > 0; --i) {
      std::swap(matches[i], matches[rng_.Below(i + 1)]);
    }
    EXPECT_EQ(pairs_of(matches), expected);
  }
}

TEST_F(Kvld, KeypointsThatAreNotFiniteMakeNoMatch) {
  std::vector<Keypoint> broken = keypoints_;
  broken[3].x_px = std::numeric_limits<float>::quiet_NaN();
  broken[5].y_px = std::numeric_limits<float>::infinity();
  broken[7].angle_deg = std::numeric_limits<float>::quiet_NaN();
  broken[9].size_px = std::numeric_limits<float>::infinity();
  std::vector<int> expected = AllOf(150);
  std::erase_if(expected, [](int i) { return i == 3 || i == 5 || i == 7 || i == 9; });
  EXPECT_EQ(FilterKvld(image_, broken, image_, keypoints_, Identity(150), {}), expected);
}

TEST_F(Kvld, HugeAndMissingSizes) {
  std::vector<Keypoint> sizeless = keypoints_;
  for (Keypoint& k : sizeless) k.size_px = 0;
  EXPECT_EQ(FilterKvld(image_, sizeless, image_, keypoints_, Identity(150), {}), AllOf(150));
  for (Keypoint& k : sizeless) k.size_px = 1e-37F, k.x_px *= 1e30F;
  EXPECT_THAT(FilterKvld(image_, sizeless, image_, keypoints_, Identity(150), {}), IsEmpty());
}

TEST_F(Kvld, TinyAndFlatImagesKeepNothing) {
  const GradientPyramid tiny(BusyImage(1, 1, 1));
  const GradientPyramid flat(GrayImage{64, 64, std::vector<std::uint8_t>(64 * 64, 9)});
  for (const GradientPyramid* image : {&tiny, &flat}) {
    EXPECT_THAT(FilterKvld(*image, keypoints_, *image, keypoints_, Identity(150), {}), IsEmpty());
  }
}

TEST_F(Kvld, AnIndexWithoutKeypointThrows) {
  for (const FeatureMatch bad : {FeatureMatch{150, 0, 0}, {0, 150, 0}, {-1, 0, 0}, {0, -1, 0}}) {
    std::vector<FeatureMatch> matches = Identity(10);
    matches.push_back(bad);
    EXPECT_THROW(Filter(matches), std::invalid_argument);
  }
}

TEST(KvldOptions, BadValuesThrow) {
  KvldOptions good;
  EXPECT_NO_THROW(good.Check());
  good.num_orientation_bins = 40;  // 5 a sub-bin
  EXPECT_NO_THROW(good.Check());
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto rejects = [](auto KvldOptions::*field, auto value) {
    KvldOptions options;
    options.*field = value;
    EXPECT_THROW(options.Check(), std::invalid_argument) << value;
  };
  rejects(&KvldOptions::min_connected, 0);
  rejects(&KvldOptions::num_samples, 0);
  rejects(&KvldOptions::num_samples, 33);
  rejects(&KvldOptions::num_sub_bins, 1);
  rejects(&KvldOptions::num_sub_bins, 17);
  for (const int bins : {0, 16, 23, 32, 48, 72}) rejects(&KvldOptions::num_orientation_bins, bins);
  rejects(&KvldOptions::contrast_weight, -0.1);
  rejects(&KvldOptions::orientation_weight, nan);
  rejects(&KvldOptions::min_distance_px, -1.0);
  rejects(&KvldOptions::max_contrast, nan);
  rejects(&KvldOptions::inlier_rate, 0.0);
  rejects(&KvldOptions::inlier_rate, 1.1);
  rejects(&KvldOptions::distance_threshold, nan);
  rejects(&KvldOptions::descriptor_threshold, -1.0);
}

}  // namespace
}  // namespace panofix
