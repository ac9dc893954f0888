#include "common/features/matcher.h"

#include <gtest/gtest.h>

#include <limits>
#include <stdexcept>

#include "tests/common/features/random_descriptors.h"

namespace panofix {
namespace {

constexpr std::size_t kSize = kDescriptorSize;
using Bytes = std::vector<std::uint8_t>;

std::int64_t DistanceSq(const Bytes& a, std::size_t i, const Bytes& b, std::size_t j) {
  std::int64_t sum = 0;
  for (std::size_t d = 0; d < kSize; ++d) {
    const std::int64_t diff = std::int64_t{a[i * kSize + d]} - b[j * kSize + d];
    sum += diff * diff;
  }
  return sum;
}

// The definition, pair by pair.
std::vector<FeatureMatch> Oracle(const Bytes& query, const Bytes& database,
                                 const MatchOptions& options) {
  const std::size_t n = query.size() / kSize, m = database.size() / kSize;
  const auto nearest = [&](const Bytes& from, std::size_t i, const Bytes& to, std::size_t count,
                           std::int64_t* best, std::int64_t* second) {
    std::size_t best_j = 0;
    *best = *second = std::numeric_limits<std::int64_t>::max();
    for (std::size_t j = 0; j < count; ++j) {
      const std::int64_t d = DistanceSq(from, i, to, j);
      if (d < *best) {
        *second = *best, *best = d, best_j = j;
      } else {
        *second = std::min(*second, d);
      }
    }
    return best_j;
  };
  std::vector<FeatureMatch> matches;
  for (std::size_t i = 0; i < n && m > 0; ++i) {
    std::int64_t best, second, back_best, back_second;
    const std::size_t j = nearest(query, i, database, m, &best, &second);
    const double ratio =
        std::sqrt(static_cast<double>(best)) / std::sqrt(static_cast<double>(second));
    if (options.max_ratio < 1 && (m < 2 || !(ratio < options.max_ratio))) continue;
    if (options.mutual && nearest(database, j, query, n, &back_best, &back_second) != i) continue;
    matches.push_back({static_cast<int>(i), static_cast<int>(j), static_cast<int>(best)});
  }
  return matches;
}

void ExpectSame(const std::vector<FeatureMatch>& actual,
                const std::vector<FeatureMatch>& expected) {
  ASSERT_EQ(actual.size(), expected.size());
  for (std::size_t i = 0; i < actual.size(); ++i) {
    EXPECT_EQ(actual[i].query_idx, expected[i].query_idx);
    EXPECT_EQ(actual[i].database_idx, expected[i].database_idx);
    EXPECT_EQ(actual[i].distance_sq, expected[i].distance_sq);
  }
}

TEST(MatchDescriptors, FindsDisturbedCopiesInAnyOrder) {
  Rng rng(1, "tests/copies");
  const Bytes database = RandomDescriptors(300, &rng);
  Bytes reversed;
  for (std::size_t i = 300; i-- > 0;) {
    reversed.insert(reversed.end(), &database[i * kSize], &database[i * kSize] + kSize);
  }
  const auto matches = MatchDescriptors(Disturbed(reversed, 5, &rng), database, {});
  ASSERT_EQ(matches.size(), 300U);
  for (std::size_t i = 0; i < 300; ++i) {
    EXPECT_EQ(matches[i].query_idx, static_cast<int>(i));
    EXPECT_EQ(matches[i].database_idx, static_cast<int>(299 - i));
  }
}

TEST(MatchDescriptors, AgreesWithBruteForce) {
  Rng rng(1, "tests/brute_force");
  for (const bool mutual : {false, true}) {
    for (const double max_ratio : {0.5, 0.8, 0.97, 1.0}) {
      const Bytes database = RandomDescriptors(120, &rng, 64);
      // Some near copies, some that the ratio has to judge, some strangers.
      Bytes query = Disturbed(database, 4, &rng);
      query.resize(40 * kSize);
      const Bytes far = Disturbed(database, 30, &rng);
      query.insert(query.end(), far.begin() + 40 * kSize, far.begin() + 80 * kSize);
      const Bytes strangers = RandomDescriptors(40, &rng, 64);
      query.insert(query.end(), strangers.begin(), strangers.end());
      const MatchOptions options{max_ratio, mutual};
      const auto matches = MatchDescriptors(query, database, options);
      EXPECT_GT(matches.size(), 20U);
      ExpectSame(matches, Oracle(query, database, options));
    }
  }
}

TEST(MatchDescriptors, EqualsGoToTheFirst) {
  Rng rng(1, "tests/equals");
  const Bytes one = RandomDescriptors(1, &rng);
  Bytes thrice;
  for (int i = 0; i < 3; ++i) thrice.insert(thrice.end(), one.begin(), one.end());
  const auto all = MatchDescriptors(thrice, thrice, {1.0, false});
  ASSERT_EQ(all.size(), 3U);
  for (const FeatureMatch& m : all) EXPECT_EQ(m.database_idx, 0);
  const auto mutual = MatchDescriptors(thrice, thrice, {1.0, true});
  ASSERT_EQ(mutual.size(), 1U);
  EXPECT_EQ(mutual[0].query_idx, 0);
  // A repeated structure has no clear nearest.
  EXPECT_TRUE(MatchDescriptors(one, thrice, {0.9, false}).empty());
}

TEST(MatchDescriptors, MutualMeansBothWays) {
  // Both queries are nearest to the one entry; it is nearest to the second.
  Bytes query(2 * kSize, 0), database(kSize, 10);
  query[0] = 200;
  const auto matches = MatchDescriptors(query, database, {1.0, true});
  ASSERT_EQ(matches.size(), 1U);
  EXPECT_EQ(matches[0].query_idx, 1);
  EXPECT_EQ(MatchDescriptors(query, database, {1.0, false}).size(), 2U);
}

TEST(MatchDescriptors, TheLargestDistanceDoesNotOverflow) {
  const Bytes zeros(kSize, 0), full(kSize, 255);
  const auto matches = MatchDescriptors(zeros, full, {1.0, true});
  ASSERT_EQ(matches.size(), 1U);
  EXPECT_EQ(matches[0].distance_sq, 128 * 255 * 255);
  EXPECT_EQ(DescriptorDistanceSq(zeros.data(), full.data()), 128 * 255 * 255);
}

TEST(DescriptorDistance, IsTheSumOfSquares) {
  Rng rng(1, "tests/distance");
  for (int trial = 0; trial < 200; ++trial) {
    const Bytes a = RandomDescriptors(1, &rng), b = RandomDescriptors(1, &rng);
    EXPECT_EQ(DescriptorDistanceSq(a.data(), b.data()), DistanceSq(a, 0, b, 0));
  }
  // Each entry in its place.
  for (std::size_t i = 0; i < kSize; ++i) {
    Bytes a(kSize, 7), b = a;
    a[i] = static_cast<std::uint8_t>(2 * i), b[i] = 255;
    EXPECT_EQ(DescriptorDistanceSq(a.data(), b.data()), DistanceSq(a, 0, b, 0)) << i;
  }
}

TEST(MatchDescriptors, FewOrNoDescriptors) {
  Rng rng(1, "tests/few");
  const Bytes one = RandomDescriptors(1, &rng), two = RandomDescriptors(2, &rng);
  EXPECT_TRUE(MatchDescriptors({}, one, {}).empty());
  EXPECT_TRUE(MatchDescriptors(one, {}, {}).empty());
  // A lone candidate cannot pass a ratio test, however near.
  EXPECT_TRUE(MatchDescriptors(one, one, {0.8, true}).empty());
  EXPECT_EQ(MatchDescriptors(one, one, {1.0, true}).size(), 1U);
  ExpectSame(MatchDescriptors(two, two, {}), Oracle(two, two, {}));
}

TEST(MatchOptions, CheckRefusesOtherRatios) {
  EXPECT_NO_THROW(MatchOptions().Check());
  for (const double ratio : {0.0, -0.5, 1.01, std::numeric_limits<double>::quiet_NaN()}) {
    EXPECT_THROW((MatchOptions{ratio, true}.Check()), std::invalid_argument) << ratio;
  }
}

}  // namespace
}  // namespace panofix
