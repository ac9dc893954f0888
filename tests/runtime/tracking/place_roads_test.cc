#include "runtime/tracking/place_roads.h"

#include <gtest/gtest.h>

#include "tests/runtime/tracking/street_scores.h"

namespace panofix {
namespace {

constexpr double kNear_m = 12, kTolerance_m = 1e-9;

std::vector<std::uint32_t> Places(std::span<const PlaceRoads::Reached> reached) {
  std::vector<std::uint32_t> places;
  for (const auto& r : reached) places.push_back(r.place_idx);
  return places;
}

TEST(PlaceRoads, NearestFirstBothWaysAlongAStreet) {
  PlaceRoads roads(Street(10), kNear_m);
  EXPECT_EQ(roads.size(), 10U);
  const auto reached = roads.Within(4, 25, 100);
  EXPECT_EQ(Places(reached), (std::vector<std::uint32_t>{4, 3, 5, 2, 6}));
  EXPECT_NEAR(reached[4].distance_m, 20, kTolerance_m);
  EXPECT_EQ(Places(roads.Within(4, 25, 3)), (std::vector<std::uint32_t>{4, 3, 5}));
  EXPECT_EQ(Places(roads.Within(4, 0, 100)), (std::vector<std::uint32_t>{4}));
  EXPECT_TRUE(roads.Within(4, 25, 0).empty());
  EXPECT_EQ(roads.Within(0, 1e300, 100).size(), 10U);  // and no trace of the searches before
}

TEST(PlaceRoads, TheShortestOfTwoWays) {
  PlaceGraph graph;  // a ring of five sides
  graph.positions_in_map = {{0, 0, 0}, {100, 0, 0}, {200, 0, 0}, {200, 100, 0}, {0, 100, 0}};
  graph.links = {{1, 4}, {2}, {3}, {4}, {}};
  PlaceRoads roads(graph, kNear_m);
  const auto reached = roads.Within(0, 1000, 10);
  EXPECT_EQ(Places(reached), (std::vector<std::uint32_t>{0, 1, 4, 2, 3}));
  EXPECT_NEAR(reached[4].distance_m, 300, kTolerance_m);
}

TEST(PlaceRoads, TwoPassesOfAStreetAreJoined) {
  PlaceGraph graph;
  AddStreet({0, 0, 0}, 10, &graph);
  AddStreet({0, 3.5, 0}, 10, &graph);
  PlaceRoads roads(graph, kNear_m);
  EXPECT_EQ(Places(roads.Within(2, 5, 10)), (std::vector<std::uint32_t>{2, 12}));
}

TEST(PlaceRoads, WithoutLinksStraightLinesCount) {
  PlaceGraph graph;
  graph.positions_in_map = {{0, 0, 0}, {30, 0, 0}, {60, 0, 0}, {300, 0, 0}};
  PlaceRoads unlinked(graph, kNear_m);
  EXPECT_EQ(Places(unlinked.Within(0, 1000, 10)), (std::vector<std::uint32_t>{0, 1, 2}));
  // With links elsewhere only the one that has none is joined so.
  graph.links = {{1}, {}, {}, {}};
  graph.positions_in_map[3] = {0, 40, 0};
  PlaceRoads partly(graph, kNear_m);
  EXPECT_EQ(Places(partly.Within(2, 30, 10)), (std::vector<std::uint32_t>{2, 1}));
  EXPECT_EQ(Places(partly.Within(3, 40, 10)), (std::vector<std::uint32_t>{3, 0}));
}

TEST(PlaceRoads, NegativeCoordinatesAndCellBordersDoNotPart) {
  Rng rng(5, "tests/place_roads");
  PlaceGraph graph;
  for (int i = 0; i < 300; ++i) {
    graph.positions_in_map.push_back({rng.Uniform(-60, 60), rng.Uniform(-60, 60), 0});
  }
  graph.links.resize(300);
  graph.links[0].push_back(1);
  PlaceRoads roads(graph, kNear_m);
  // Direct neighbours by brute force: whatever is near, and the 16 nearest at least.
  for (std::uint32_t i = 0; i < 300; ++i) {
    std::vector<double> distances_m;
    for (const auto& position : graph.positions_in_map) {
      distances_m.push_back((position - graph.positions_in_map[i]).norm());
    }
    std::sort(distances_m.begin(), distances_m.end());
    const auto reached = roads.Within(i, kNear_m, PlaceRoads::kMaxNear + 1);
    for (std::size_t k = 0; k < reached.size(); ++k) {
      EXPECT_NEAR(reached[k].distance_m, distances_m[k], kTolerance_m);
    }
    EXPECT_GE(reached.size(), 2U);
  }
}

// A thousand panoramas on one spot: all within no distance, and no n^2 edges.
TEST(PlaceRoads, ACrowdOnOneSpotStaysJoined) {
  PlaceGraph graph;
  graph.positions_in_map.assign(1000, {5, 5, 5});
  PlaceRoads roads(graph, kNear_m);
  EXPECT_EQ(roads.Within(500, 0, 100).size(), 100U);
  const auto nothing = roads.Within(500, 0, 1);
  EXPECT_EQ(Places(nothing), (std::vector<std::uint32_t>{500}));
}

TEST(PlaceRoads, RefusesBrokenGraphs) {
  PlaceGraph graph = Street(3);
  graph.links[1].push_back(3);
  EXPECT_THROW(PlaceRoads(graph, kNear_m), std::invalid_argument);
  graph = Street(3);
  graph.links.pop_back();
  EXPECT_THROW(PlaceRoads(graph, kNear_m), std::invalid_argument);
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity(), 1e10}) {
    graph = Street(3);
    graph.positions_in_map[1].y() = bad;
    EXPECT_THROW(PlaceRoads(graph, kNear_m), std::invalid_argument);
  }
  graph = Street(3);
  graph.links[0] = {0, 0, 1, 1};  // to itself, and twice: harmless
  PlaceRoads roads(graph, kNear_m);
  EXPECT_EQ(Places(roads.Within(0, 10, 10)), (std::vector<std::uint32_t>{0, 1}));
}

TEST(PlaceRoads, Empty) {
  const PlaceRoads roads({}, kNear_m);
  EXPECT_EQ(roads.size(), 0U);
}

}  // namespace
}  // namespace panofix
