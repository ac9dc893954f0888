// The filter over whole drives: what a vehicle does, and what its retrieval says.
#include <gtest/gtest.h>

#include "tests/runtime/tracking/street_scores.h"

namespace panofix {
namespace {

constexpr double kDt_s = 0.5;
constexpr double kStep_m = 5;            // a frame: 10 m/s
constexpr double kHere_m = 15;           // a panorama's neighbours count as the place
constexpr double kSumTolerance = 1e-12;  // sums of doubles of 1

Eigen::Vector3d At(double x_m, double y_m = 0) { return {x_m, y_m, 0}; }

class Drive {
 public:
  explicit Drive(PlaceGraph graph, const PlaceFilterOptions& options = {})
      : graph_(std::move(graph)), filter_(graph_, options), rng_(3, "tests/place_drive") {}

  // A frame at a position that retrieval sees.
  double See(const Eigen::Vector3d& position, double dt_s = kDt_s) {
    return Update(ScoresAt(graph_, position, &rng_), position, dt_s);
  }
  // A frame of nothing that the map knows; it was searched in vain.
  void SeeNothing() {
    (void)Update(UnrelatedScores(graph_.positions_in_map.size(), &rng_), At(0), kDt_s);
    filter_.UpdateNoFix(filter_.Likely(0.95, 12));
  }
  double Update(const std::vector<float>& scores, const Eigen::Vector3d& position, double dt_s) {
    filter_.Predict(dt_s);
    filter_.UpdateSimilarity(scores);
    EXPECT_NEAR(TotalBelief(filter_), 1, kSumTolerance);
    return filter_.BeliefNear(position, kHere_m);
  }
  PlaceFilter& filter() { return filter_; }
  const PlaceGraph& graph() const { return graph_; }
  Rng& rng() { return rng_; }

 private:
  PlaceGraph graph_;
  PlaceFilter filter_;
  Rng rng_;
};

TEST(PlaceDrive, FindsThePlaceWithinFewFramesAndFollows) {
  Drive drive(Street(100));
  for (int i = 0; i < 150; ++i) {
    const Eigen::Vector3d position = At(200 + kStep_m * i);
    const double here = drive.See(position);
    if (i < 4) continue;
    EXPECT_GT(here, 0.7) << i;
    const std::uint32_t best = drive.filter().Likely(1, 1).at(0);
    EXPECT_LE((drive.graph().positions_in_map[best] - position).norm(), kHere_m) << i;
  }
  EXPECT_LT(drive.filter().off_map(), 0.05);
}

TEST(PlaceDrive, FollowsThroughFramesThatShowNothing) {
  Drive drive(Street(100));
  int num_right = 0;
  for (int i = 0; i < 120; ++i) {
    const Eigen::Vector3d position = At(200 + kStep_m * i);
    const bool blind = i > 5 && i % 3 == 0;
    const double here = blind ? drive.Update(UnrelatedScores(100, &drive.rng()), position, kDt_s)
                              : drive.See(position);
    num_right += i >= 5 && here > 0.5;
  }
  EXPECT_GE(num_right, 110);  // of 115
}

TEST(PlaceDrive, FollowsBackwardsAndThroughAStop) {
  Drive drive(Street(100));
  double x_m = 500, here = 0;
  for (int i = 0; i < 20; ++i) here = drive.See(At(x_m += kStep_m));
  for (int i = 0; i < 40; ++i) here = drive.See(At(x_m));
  EXPECT_GT(here, 0.8);
  for (int i = 0; i < 40; ++i) {
    here = drive.See(At(x_m -= kStep_m));
    EXPECT_GT(here, 0.6) << i;
  }
}

// The very same frame again and again: one look-alike among its scores must not win by patience.
TEST(PlaceDrive, RepeatedFramesDoNotMoveIt) {
  Drive drive(Street(100));
  for (int i = 0; i < 10; ++i) (void)drive.See(At(300 + kStep_m * i));
  std::vector<float> frame = ScoresAt(drive.graph(), At(350), &drive.rng());
  frame[80] = 0.27F;  // beside 0.32 of the right place
  for (int i = 0; i < 50; ++i) {
    EXPECT_GT(drive.Update(frame, At(350), kDt_s), 0.5) << i;
  }
}

TEST(PlaceDrive, OneLookAlikeFrameDoesNotCarryItAway) {
  Drive drive(Street(100));
  for (int i = 0; i < 10; ++i) (void)drive.See(At(300 + kStep_m * i));
  const std::vector<double> before(drive.filter().belief().begin(), drive.filter().belief().end());
  std::vector<float> liar = UnrelatedScores(100, &drive.rng());
  AddSight(drive.graph(), At(800), &liar);
  drive.filter().UpdateSimilarity(liar);
  // Before against after, between any two places: the promised factor.
  constexpr double kMostFactor = 20 * (1 + 1e-9);  // and rounding
  double least = 1e300, most = 0;
  for (std::size_t p = 0; p < before.size(); ++p) {
    const double factor = drive.filter().belief()[p] / before[p];
    least = std::min(least, factor);
    most = std::max(most, factor);
  }
  EXPECT_LE(most / least, kMostFactor);
  EXPECT_GT(most / least, 10);
  EXPECT_GT(drive.filter().BeliefNear(At(350), kHere_m), 0.8);
}

TEST(PlaceDrive, AJumpIsFollowedAfterAFewFrames) {
  Drive drive(Street(100));
  for (int i = 0; i < 20; ++i) (void)drive.See(At(100 + kStep_m * i));
  double here = 0;
  for (int i = 0; i < 6; ++i) here = drive.See(At(800 + kStep_m * i));
  EXPECT_GT(here, 0.7);
}

// Two streets of the same look, 1 km apart. The vehicle starts where they are alike, with a
// third, unlike, street before one of them as its history in the second test.
struct Twins {
  PlaceGraph graph;
  Twins() {
    AddStreet(At(0), 40, &graph);
    AddStreet(At(0, 1000), 40, &graph);
  }
  std::vector<float> Scores(double x_m, Rng* rng) const {
    std::vector<float> scores = UnrelatedScores(80, rng);
    std::copy_n(scores.begin(), 40, scores.begin() + 40);
    AddSight(graph, At(x_m), &scores);
    AddSight(graph, At(x_m, 1000), &scores);
    return scores;
  }
};

TEST(PlaceDrive, TwinStreetsSplitTheBeliefEvenly) {
  const Twins twins;
  Drive drive(twins.graph);
  for (int i = 0; i < 20; ++i) {
    const double x_m = 100 + kStep_m * i;
    const double first = drive.Update(twins.Scores(x_m, &drive.rng()), At(x_m), kDt_s);
    EXPECT_NEAR(first, drive.filter().BeliefNear(At(x_m, 1000), kHere_m), 1e-9) << i;
  }
  EXPECT_GT(drive.filter().BeliefNear(At(195), kHere_m), 0.4);
  const auto likely = drive.filter().Likely(0.9, 20);
  const auto in_second =
      std::count_if(likely.begin(), likely.end(), [](auto p) { return p >= 40; });
  EXPECT_GT(in_second, 0);
  EXPECT_LT(in_second, static_cast<std::ptrdiff_t>(likely.size()));
}

TEST(PlaceDrive, HistoryTellsTwinStreetsApart) {
  const Twins twins;
  Drive drive(twins.graph);
  for (int i = 0; i < 8; ++i) (void)drive.See(At(60 + kStep_m * i, 1000));  // unlike so far
  for (int i = 8; i < 40; ++i) {
    const double x_m = 60 + kStep_m * i;
    const double right = drive.Update(twins.Scores(x_m, &drive.rng()), At(x_m, 1000), kDt_s);
    EXPECT_GT(right, 3 * drive.filter().BeliefNear(At(x_m), kHere_m)) << i;
  }
}

TEST(PlaceDrive, LeavesTheMapAndComesBack) {
  Drive drive(Street(100));
  for (int i = 0; i < 20; ++i) (void)drive.See(At(895 + kStep_m * i));
  ASSERT_LT(drive.filter().off_map(), 0.05);
  for (int i = 0; i < 10; ++i) drive.SeeNothing();
  EXPECT_GT(drive.filter().off_map(), 0.5);
  for (int i = 0; i < 50; ++i) drive.SeeNothing();
  EXPECT_GT(drive.filter().off_map(), 0.9);
  double here = 0;
  for (int i = 0; i < 6; ++i) here = drive.See(At(20 + kStep_m * i));
  EXPECT_GT(here, 0.7);
}

TEST(PlaceDrive, AFrameBehindABusDestroysNothing) {
  Drive drive(Street(100));
  for (int i = 0; i < 20; ++i) (void)drive.See(At(300 + kStep_m * i));
  drive.SeeNothing();
  EXPECT_GT(drive.filter().BeliefNear(At(400), kHere_m), 0.5);
  EXPECT_LT(drive.filter().off_map(), 0.2);
}

TEST(PlaceDrive, FollowsWithoutLinks) {
  PlaceGraph graph = Street(100);
  graph.links.clear();
  Drive drive(graph);
  for (int i = 0; i < 60; ++i) {
    const double here = drive.See(At(300 + kStep_m * i));
    EXPECT_TRUE(i < 4 || here > 0.7) << i << ": " << here;
  }
}

// 200 streets of 100. Not about time, but with anything quadratic this test would not end.
TEST(PlaceDrive, TwentyThousandPanoramas) {
  PlaceGraph graph;
  for (int street = 0; street < 200; ++street) AddStreet(At(0, 60 * street), 100, &graph);
  Drive drive(std::move(graph));
  double here = 0;
  for (int i = 0; i < 40; ++i) here = drive.See(At(100 + kStep_m * i, 60 * 120));
  EXPECT_GT(here, 0.6);
  (void)drive.See(At(0), 1e6);
  EXPECT_EQ(drive.filter().Likely(0.5, 30).size(), 30U);
}

}  // namespace
}  // namespace panofix
