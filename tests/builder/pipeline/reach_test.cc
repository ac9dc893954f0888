#include "builder/pipeline/reach.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "common/base/rng.h"
#include "common/geometry/attitude.h"

namespace panofix {
namespace {

constexpr double kMetresPerDegree = 111320;

// Great-circle distance on a sphere: good to half a percent.
double Distance_m(const Geodetic& a, const Geodetic& b) {
  const double north = (a.lat_deg - b.lat_deg) * kMetresPerDegree;
  const double east = AngleDifferenceDeg(a.lon_deg, b.lon_deg) * kMetresPerDegree *
                      std::cos(0.5 * (a.lat_deg + b.lat_deg) * kRadPerDeg);
  return std::hypot(north, east);
}

struct World {
  std::vector<PanoramaRecord> records;
  std::vector<std::string> group, shard;
};

// Scattered over 600 m with random links, some of them to ids that are not there.
World Scattered(std::uint64_t seed, double lat_deg, double lon_deg) {
  Rng rng(seed, "tests/reach");
  World world;
  constexpr int kCount = 120;
  for (int i = 0; i < kCount; ++i) {
    PanoramaRecord r;
    r.id = "p" + std::to_string(i);
    r.position.lat_deg = lat_deg + rng.Uniform(0, 600) / kMetresPerDegree;
    const double east_deg = rng.Uniform(0, 600) / kMetresPerDegree / std::cos(lat_deg * kRadPerDeg);
    r.position.lon_deg = AngleDifferenceDeg(lon_deg + east_deg, 0);
    if (i % 3 == 0) r.links = {"p" + std::to_string(rng.Below(2 * kCount))};
    world.records.push_back(r);
    world.group.push_back("g" + std::to_string(rng.Below(10)));
    world.shard.push_back("s" + std::to_string(i % 40));
  }
  return world;
}

// Shards in reach by the definition, over all pairs.
std::set<std::string> BruteForce(const World& world, const std::string& group, int hops,
                                 double metres) {
  const std::size_t n = world.records.size();
  std::vector<int> hops_to(n, 1000);
  for (std::size_t i = 0; i < n; ++i) {
    if (world.group[i] == group) hops_to[i] = 0;
  }
  const auto linked = [&](std::size_t a, std::size_t b) {
    const auto names = [&](std::size_t from, std::size_t to) {
      const auto& links = world.records[from].links;
      return std::count(links.begin(), links.end(), world.records[to].id) > 0;
    };
    return names(a, b) || names(b, a);
  };
  for (int round = 0; round < hops; ++round) {
    for (std::size_t a = 0; a < n; ++a) {
      for (std::size_t b = 0; b < n; ++b) {
        if (linked(a, b)) hops_to[b] = std::min(hops_to[b], hops_to[a] + 1);
      }
    }
  }
  std::set<std::string> shards;
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < n; ++j) {
      const bool is_near =
          world.group[i] == group &&
          Distance_m(world.records[i].position, world.records[j].position) <= metres;
      if (is_near || hops_to[j] <= hops) shards.insert(world.shard[j]);
    }
  }
  return shards;
}

void ExpectNoneIsMissed(const World& world) {
  for (const auto& [hops, metres] : {std::pair{0, 1.0}, {0, 80.0}, {2, 30.0}, {6, 45.0}}) {
    const auto found = ShardsInReach(world.records, world.group, world.shard, {hops, metres});
    for (const auto& [group, shards] : found) {
      const auto expected = BruteForce(world, group, hops, metres);
      EXPECT_TRUE(std::includes(shards.begin(), shards.end(), expected.begin(), expected.end()))
          << group << " " << hops << " hops, " << metres << " m";
    }
  }
}

TEST(ShardsInReach, MissesNone) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) ExpectNoneIsMissed(Scattered(seed, 48.85, 2.3));
}

TEST(ShardsInReach, MissesNoneInTheNorthAndAcrossTheDateLine) {
  ExpectNoneIsMissed(Scattered(6, 69.6, 18.9));
  ExpectNoneIsMissed(Scattered(7, -16.8, 179.998));
}

TEST(ShardsInReach, LeavesOutWhatIsFar) {
  World world = Scattered(1, 48.85, 2.3);
  for (PanoramaRecord& r : world.records) r.links.clear();
  const auto found = ShardsInReach(world.records, world.group, world.shard, {6, 1.0});
  std::size_t num_named = 0;
  for (const auto& [group, shards] : found) num_named += shards.size();
  EXPECT_LE(num_named, 140U);  // 120 are their own
  EXPECT_TRUE(ShardsInReach({}, {}, {}, {2, 45}).empty());
}

}  // namespace
}  // namespace panofix
