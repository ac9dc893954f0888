#include "runtime/tracking/place_filter.h"

#include <gtest/gtest.h>

#include <limits>

#include "tests/runtime/tracking/street_scores.h"

namespace panofix {
namespace {

constexpr double kTolerance = 1e-12;  // a few roundings of numbers below 1
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Half on the map, all places alike.
void ExpectFresh(const PlaceFilter& filter) {
  EXPECT_NEAR(filter.off_map(), 0.5, kTolerance);
  for (const double belief : filter.belief()) {
    EXPECT_NEAR(belief, 0.5 / static_cast<double>(filter.belief().size()), kTolerance);
  }
}

TEST(PlaceFilter, StartsKnowingNothing) {
  const PlaceFilter filter(Street(10), {});
  ExpectFresh(filter);
  EXPECT_EQ(filter.Likely(0.5, 3), (std::vector<std::uint32_t>{0, 1, 2}));
}

TEST(PlaceFilter, AFixGathersBelief) {
  PlaceFilter filter(Street(100), {});
  filter.UpdateFix({502, 2, 0}, 0.3);
  EXPECT_GT(filter.BeliefNear({502, 2, 0}, 15), 0.9);
  EXPECT_EQ(filter.Likely(0.1, 5).front(), 50U);
  EXPECT_LT(filter.off_map(), 0.05);
  EXPECT_NEAR(TotalBelief(filter), 1, kTolerance);
}

// What one fix says against a settled belief is a question, not an answer; a second one answers it.
TEST(PlaceFilter, OneFixElsewhereDoesNotSettleIt) {
  PlaceFilter filter(Street(100), {});
  for (int i = 0; i < 10; ++i) {
    filter.Predict(0.5);
    filter.UpdateFix({200, 0, 0}, 0.3);
  }
  filter.Predict(0.5);
  filter.UpdateFix({800, 0, 0}, 0.3);
  EXPECT_LT(filter.BeliefNear({800, 0, 0}, 30), 0.9);
  EXPECT_GT(filter.BeliefNear({200, 0, 0}, 30), 0.1);
  filter.Predict(0.5);
  filter.UpdateFix({800, 0, 0}, 0.3);
  EXPECT_GT(filter.BeliefNear({800, 0, 0}, 30), 0.9);
}

TEST(PlaceFilter, AFixBringsItBackFromOffTheMap) {
  PlaceFilter filter(Street(100), {});
  std::vector<std::uint32_t> all(100);
  for (std::uint32_t p = 0; p < 100; ++p) all[p] = p;
  for (int i = 0; i < 200; ++i) {
    filter.Predict(0.1);
    filter.UpdateNoFix(all);
  }
  EXPECT_GT(filter.off_map(), 0.95);
  for (int i = 0; i < 2; ++i) {
    filter.Predict(0.1);
    filter.UpdateFix({400, 0, 0}, 0.5);
  }
  EXPECT_GT(filter.BeliefNear({400, 0, 0}, 15), 0.8);
}

TEST(PlaceFilter, NoFixCountsAgainstThePlacesSearched) {
  PlaceFilter filter(Street(10), {});
  const std::vector<std::uint32_t> searched{3, 4, 3};
  filter.UpdateNoFix(searched);
  EXPECT_NEAR(filter.belief()[3], filter.belief()[0] / 2, kTolerance);  // once, though named twice
  EXPECT_NEAR(filter.belief()[4], filter.belief()[0] / 2, kTolerance);
  EXPECT_GT(filter.off_map(), 0.5);
  filter.Reset();
  filter.UpdateNoFix({});
  ExpectFresh(filter);
}

TEST(PlaceFilter, BeliefKeepsToTheRoad) {
  // Two streets 20 m apart that meet at their far ends only, 200 m away.
  PlaceGraph graph;
  AddStreet({0, 0, 0}, 20, &graph);
  AddStreet({0, 20, 0}, 20, &graph);
  graph.links[19].push_back(39);
  PlaceFilterOptions options;
  options.teleport_share = options.leave_share = 0;
  PlaceFilter filter(graph, options);
  for (int i = 0; i < 4; ++i) filter.UpdateFix({0, 0, 0}, 0.1);
  filter.Predict(1);  // 42 m
  EXPECT_GT(filter.belief()[4], 0.01);
  EXPECT_LT(filter.belief()[7], 1e-6);   // 70 m
  EXPECT_LT(filter.belief()[20], 1e-6);  // 20 m, but 400 m by road
}

TEST(PlaceFilter, LikelyHoldsTheShareAskedFor) {
  PlaceFilter filter(Street(50), {});
  filter.UpdateFix({100, 0, 0}, 20);
  for (const double share : {0.1, 0.5, 0.9, 0.99}) {
    const auto likely = filter.Likely(share, 50);
    double held = 0;
    for (const std::uint32_t p : likely) held += filter.belief()[p];
    const double wanted = share * (1 - filter.off_map());
    EXPECT_GE(held, wanted - kTolerance);
    EXPECT_LT(held - filter.belief()[likely.back()], wanted + kTolerance);  // none too many
    for (std::size_t i = 1; i < likely.size(); ++i) {
      EXPECT_GE(filter.belief()[likely[i - 1]], filter.belief()[likely[i]]);
    }
  }
  EXPECT_TRUE(filter.Likely(0, 50).empty());
  EXPECT_TRUE(filter.Likely(1, 0).empty());
  EXPECT_EQ(filter.Likely(2, 1000).size(), 50U);
}

TEST(PlaceFilter, TimeThatTellsNothingForgets) {
  for (const double dt_s : {0.0, -1.0, kNan, kInfinity, -kInfinity}) {
    PlaceFilter filter(Street(20), {});
    filter.UpdateFix({50, 0, 0}, 1);
    filter.Predict(dt_s);
    ExpectFresh(filter);
  }
}

TEST(PlaceFilter, HugeTimesTendToKnowingNothing) {
  for (const double dt_s : {1e5, 1e18, std::numeric_limits<double>::max()}) {
    PlaceFilter filter(Street(20), {});
    filter.UpdateFix({50, 0, 0}, 1);
    filter.Predict(dt_s);
    EXPECT_NEAR(filter.off_map(), 0.5, kTolerance);
    for (const double belief : filter.belief()) EXPECT_NEAR(belief, 0.5 / 20, kTolerance);
  }
  PlaceFilter filter(Street(20), {});
  filter.UpdateFix({50, 0, 0}, 1);
  const double before = filter.BeliefNear({50, 0, 0}, 15);
  filter.Predict(std::numeric_limits<double>::denorm_min());
  EXPECT_GT(filter.BeliefNear({50, 0, 0}, 25), 0.9 * before);
}

TEST(PlaceFilter, AnEmptyMapIsOffTheMap) {
  PlaceFilter filter({}, {});
  filter.Predict(1);
  filter.UpdateSimilarity({});
  filter.UpdateFix({0, 0, 0}, 1);
  filter.UpdateNoFix({});
  EXPECT_EQ(filter.off_map(), 1);
  EXPECT_TRUE(filter.belief().empty());
  EXPECT_TRUE(filter.Likely(0.9, 5).empty());
  EXPECT_EQ(filter.BeliefNear({0, 0, 0}, 1e9), 0);
}

TEST(PlaceFilter, OnePanorama) {
  PlaceFilter filter(Street(1), {});
  filter.UpdateSimilarity(std::vector<float>{0.3F});  // nothing to compare with
  ExpectFresh(filter);
  filter.UpdateFix({1, 1, 0}, 0.5);
  EXPECT_GT(filter.belief()[0], 0.9);
  filter.Predict(0.1);
  EXPECT_GT(filter.belief()[0], 0.9);
  const std::vector<std::uint32_t> searched{0};
  for (int i = 0; i < 10; ++i) filter.UpdateNoFix(searched);
  EXPECT_GT(filter.off_map(), 0.9);
  EXPECT_NEAR(TotalBelief(filter), 1, kTolerance);
}

TEST(PlaceFilter, ScoresThatSayNothingChangeNothing) {
  PlaceFilter filter(Street(10), {});
  for (const double score : {0.0, 0.2, 1.0, 7.0, -1.0, kNan, kInfinity}) {
    filter.UpdateSimilarity(std::vector<float>(10, static_cast<float>(score)));
    ExpectFresh(filter);
  }
}

TEST(PlaceFilter, HostileScoresLeaveItWhole) {
  PlaceFilter filter(Street(12), {});
  std::vector<float> scores(12, 0.1F);
  scores[1] = std::numeric_limits<float>::quiet_NaN();
  scores[2] = std::numeric_limits<float>::infinity();
  scores[3] = -5;
  scores[4] = 1e30F;
  filter.UpdateSimilarity(scores);
  EXPECT_EQ(filter.belief()[2], filter.belief()[4]);  // both count as 1
  EXPECT_EQ(filter.belief()[1], filter.belief()[3]);  // both count as 0
  for (int i = 0; i < 2000; ++i) {
    if (i % 2 == 0) filter.Predict(0.01);
    filter.UpdateSimilarity(scores);
    ASSERT_NEAR(TotalBelief(filter), 1, kTolerance) << i;
  }
}

TEST(PlaceFilter, FixesThatSayNothingChangeNothing) {
  PlaceFilter filter(Street(10), {});
  filter.UpdateFix({kNan, 0, 0}, 1);
  filter.UpdateFix({0, kInfinity, 0}, 1);
  filter.UpdateFix({0, 0, 0}, kNan);
  filter.UpdateFix({0, 0, 0}, kInfinity);
  filter.UpdateFix({0, 0, 0}, -1);
  ExpectFresh(filter);
  filter.UpdateFix({1e12, 0, 0}, 1);  // far from all: as likely wrong as any
  EXPECT_NEAR(filter.off_map(), 0.5, kTolerance);
  filter.UpdateFix({0, 0, 0}, 0);  // a sigma of nothing is no reason to fail
  EXPECT_GT(filter.belief()[0], 0.5);
}

// Without teleports and returns belief can underflow to nothing everywhere; then it starts anew.
TEST(PlaceFilter, NothingLeftStartsAnew) {
  PlaceFilterOptions options;
  options.teleport_share = options.leave_share = options.off_map_likelihood = 0;
  PlaceFilter filter(Street(4), options);
  const std::vector<std::uint32_t> all{0, 1, 2, 3};
  for (int i = 0; i < 1200; ++i) filter.UpdateNoFix(all);
  ASSERT_EQ(filter.off_map(), 1);
  filter.UpdateSimilarity(std::vector<float>{0.1F, 0.2F, 0.1F, 0.1F});
  ExpectFresh(filter);
}

TEST(PlaceFilter, RefusesWrongCalls) {
  PlaceFilter filter(Street(3), {});
  EXPECT_THROW(filter.UpdateSimilarity(std::vector<float>(2)), std::invalid_argument);
  EXPECT_THROW(filter.UpdateNoFix(std::vector<std::uint32_t>{3}), std::invalid_argument);
  ExpectFresh(filter);
  const auto refused = [](auto change) {
    PlaceFilterOptions options;
    change(options);
    EXPECT_THROW(PlaceFilter(Street(3), options), std::invalid_argument);
  };
  refused([](auto& o) { o.max_speed_mps = -1; });
  refused([](auto& o) { o.max_speed_mps = kInfinity; });
  refused([](auto& o) { o.reach_margin_m = kNan; });
  refused([](auto& o) { o.teleport_share = 1.1; });
  refused([](auto& o) { o.leave_share = 0.6; });
  refused([](auto& o) { o.off_map_likelihood = -1; });
}

}  // namespace
}  // namespace panofix
