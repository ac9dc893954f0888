#pragma once
// Exact nearest neighbours of byte descriptors, with ratio and mutual check.

#include <cstdint>
#include <span>
#include <vector>

namespace panofix {

struct MatchOptions {
  double max_ratio = 0.8;  // nearest / second nearest distance (Lowe); 1 switches it off
  bool mutual = true;      // each must be the other's nearest
  void Check() const;      // throws std::invalid_argument
};

struct FeatureMatch {
  int query_idx = 0, database_idx = 0;
  int distance_sq = 0;  // squared L2 of the byte descriptors
};

// Brute force over N x 128 and M x 128 bytes: O(N M), about 10 ns a pair without AVX2, 2 ns with;
// both count in integers and agree exactly. Matches come in the order of the query.
[[nodiscard]] std::vector<FeatureMatch> MatchDescriptors(std::span<const std::uint8_t> query,
                                                         std::span<const std::uint8_t> database,
                                                         const MatchOptions& options);

// Squared L2 distance of two 128-byte descriptors.
[[nodiscard]] int DescriptorDistanceSq(const std::uint8_t* a, const std::uint8_t* b);

}  // namespace panofix
