#include "builder/augment/station_planner.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace panofix {
namespace {

constexpr double kTolerance_m = 1e-9;  // a few roundings of metres

MapPanorama Panorama(const char* id, const Eigen::Vector3d& position,
                     std::vector<std::uint32_t> links) {
  MapPanorama panorama;
  panorama.id = id;
  panorama.map_from_pano.translation = position;
  panorama.links = std::move(links);
  return panorama;
}

// "a" and "b", 10 m apart to the north, b a metre higher.
std::vector<MapPanorama> Pair() {
  return {Panorama("a", {100, 200, 5}, {1}), Panorama("b", {100, 210, 6}, {0})};
}

bool Has(const std::vector<Station>& stations, const Eigen::Vector3d& position) {
  return std::any_of(stations.begin(), stations.end(), [&](const Station& station) {
    return (station.position_in_pano - position).norm() < kTolerance_m;
  });
}

TEST(PlanStations, SplitsALinkBetweenItsEnds) {
  StationOptions options;
  options.beyond_m = 0;
  const auto plan = PlanStations(Pair(), options);
  ASSERT_EQ(plan.size(), 2U);
  // 10.05 m in 4 parts: the first quarter and the middle (a tie) to a, the last quarter to b.
  ASSERT_EQ(plan[0].size(), 3U);
  ASSERT_EQ(plan[1].size(), 2U);
  EXPECT_EQ(plan[0][0].position_in_pano, Eigen::Vector3d::Zero());
  EXPECT_EQ(plan[1][0].position_in_pano, Eigen::Vector3d::Zero());
  EXPECT_TRUE(Has(plan[0], {0, 2.5, 0.25}));
  EXPECT_TRUE(Has(plan[0], {0, 5, 0.5}));
  EXPECT_TRUE(Has(plan[1], {0, -2.5, -0.25}));
  for (std::uint32_t p = 0; p < 2; ++p) {
    for (const Station& station : plan[p]) EXPECT_EQ(station.panorama_idx, p);
  }
}

TEST(PlanStations, GoesOnBeyondAnEnd) {
  const auto plan = PlanStations(Pair(), {});  // 5 m beyond, every 2.5 m along the way
  const Eigen::Vector3d step = Eigen::Vector3d(0, 10, 1).normalized() * 2.5;
  ASSERT_EQ(plan[0].size(), 5U);
  ASSERT_EQ(plan[1].size(), 4U);
  for (const double steps : {1.0, 2.0}) {
    EXPECT_TRUE(Has(plan[0], -steps * step));
    EXPECT_TRUE(Has(plan[1], steps * step));
  }
  // A panorama with two links is no end.
  auto chain = Pair();
  chain.push_back(Panorama("c", {100, 220, 7}, {1}));
  chain[1].links = {0, 2};
  const auto chained = PlanStations(chain, {});
  for (const Station& station : chained[1]) EXPECT_LT(station.position_in_pano.norm(), 5.1);
  EXPECT_EQ(chained[1].size(), 4U);
}

TEST(PlanStations, LanesLieRightOfTheWayFromLowToHighId) {
  StationOptions options;
  options.lanes_m = {2};
  options.beyond_m = 0;
  const auto plan = PlanStations(Pair(), options);
  // The way leads north, so right is east; beside the panoramas themselves too.
  ASSERT_EQ(plan[0].size(), 4U);
  ASSERT_EQ(plan[1].size(), 3U);
  EXPECT_TRUE(Has(plan[0], {2, 0, 0}));
  EXPECT_TRUE(Has(plan[0], {2, 2.5, 0.25}));
  EXPECT_TRUE(Has(plan[0], {2, 5, 0.5}));
  EXPECT_TRUE(Has(plan[1], {2, -2.5, -0.25}));
  EXPECT_TRUE(Has(plan[1], {2, 0, 0}));
}

TEST(PlanStations, PositionsAreTrueMetresInThePanoFrame) {
  std::vector<MapPanorama> panoramas = Pair();
  // Looks east; a map that shows ground lengths 1.001 times as long.
  panoramas[0].map_from_pano.rotation = Eigen::AngleAxisd(-M_PI / 2, Eigen::Vector3d::UnitZ());
  for (MapPanorama& panorama : panoramas) panorama.point_scale = 1.001;
  panoramas[1].map_from_pano.translation = {100, 200 + 10 * 1.001, 5};
  const auto plan = PlanStations(panoramas, {});
  EXPECT_TRUE(Has(plan[0], {-2.5, 0, 0}));  // north is its left
  EXPECT_TRUE(Has(plan[0], {-5, 0, 0}));
  EXPECT_TRUE(Has(plan[1], {0, -2.5, 0}));
}

TEST(PlanStations, IndexOrderChangesNothing) {
  StationOptions options;
  options.lanes_m = {0, -1.5, 1.5};
  options.beyond_m = 0;
  // A crossing, "m" in the middle.
  const std::vector<MapPanorama> forward = {
      Panorama("c", {0, -9, 0}, {1}), Panorama("m", {0, 0, 0}, {0, 2, 3}),
      Panorama("x", {8, 1, 0}, {1}), Panorama("z", {-1, 11, 1}, {1})};
  std::vector<MapPanorama> backward(forward.rbegin(), forward.rend());
  for (MapPanorama& panorama : backward) {
    for (std::uint32_t& link : panorama.links) link = 3 - link;
  }
  const auto a = PlanStations(forward, options), b = PlanStations(backward, options);
  for (std::size_t p = 0; p < 4; ++p) {
    ASSERT_EQ(a[p].size(), b[3 - p].size());
    for (std::size_t i = 0; i < a[p].size(); ++i) {
      EXPECT_EQ(a[p][i].position_in_pano, b[3 - p][i].position_in_pano);
    }
  }
  // What lies beyond the neighbours changes nothing either.
  std::vector<MapPanorama> shard(forward.begin(), forward.begin() + 2);
  shard[1].links = {0};
  EXPECT_EQ(PlanStations(shard, options)[0].size(), a[0].size());
}

TEST(PlanStations, LeavesOutWhatShowsTheSame) {
  StationOptions options;
  options.lanes_m = {0, 1.5, -1.5};
  options.beyond_m = 0;
  // Three ways out of "m", two of them nearly one.
  const auto plan =
      PlanStations({Panorama("m", {0, 0, 0}, {1, 2, 3, 1, 0}), Panorama("p", {0, 10, 0}, {0}),
                    Panorama("q", {0.2, 10, 0}, {0}), Panorama("r", {9, -3, 0}, {0})},
                   options);
  for (const auto& stations : plan) {
    for (std::size_t i = 0; i < stations.size(); ++i) {
      for (std::size_t k = 0; k < i; ++k) {
        EXPECT_GE((stations[i].position_in_pano - stations[k].position_in_pano).norm(),
                  0.3 * options.spacing_m);
      }
    }
  }
  EXPECT_TRUE(Has(plan[0], {0, 2.5, 0}));
}

TEST(PlanStations, OnlyThePanoramasWhereNothingIsToPlan) {
  StationOptions options;
  options.lanes_m = {0, 1};
  options.beyond_m = 0;
  options.spacing_m = 0;
  EXPECT_EQ(PlanStations(Pair(), options)[0].size(), 1U);
  options = {};
  options.max_link_m = 10;  // of 10.05
  EXPECT_EQ(PlanStations(Pair(), options)[0].size(), 1U);
  options = {};
  EXPECT_TRUE(PlanStations({}, options).empty());
  std::vector<MapPanorama> panoramas = Pair();
  panoramas[1].map_from_pano.translation = panoramas[0].map_from_pano.translation;
  EXPECT_EQ(PlanStations(panoramas, options)[0].size(), 1U);
  // Straight up: stations on the way, none beside it.
  options.lanes_m = {0, 1};
  options.beyond_m = 0;
  panoramas[1].map_from_pano.translation = {100, 200, 10};
  EXPECT_EQ(PlanStations(panoramas, options)[0].size(), 2U);
}

TEST(PlanStations, RefusesWhatMakesNoSense) {
  std::vector<MapPanorama> panoramas = Pair();
  panoramas[0].links = {7};
  EXPECT_THROW(static_cast<void>(PlanStations(panoramas, {})), std::out_of_range);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double spacing_m : {-1.0, 0.01, nan}) {
    StationOptions options;
    options.spacing_m = spacing_m;
    EXPECT_THROW(options.Check(), std::invalid_argument) << spacing_m;
  }
  for (const double lane_m : {51.0, nan}) {
    StationOptions options;
    options.lanes_m = {0, lane_m};
    options.beyond_m = 0;
    EXPECT_THROW(options.Check(), std::invalid_argument) << lane_m;
  }
  for (const double max_link_m : {0.0, 2000.0, nan}) {
    StationOptions options;
    options.max_link_m = max_link_m;
    EXPECT_THROW(options.Check(), std::invalid_argument) << max_link_m;
  }
}

}  // namespace
}  // namespace panofix
