#pragma once
// The sparse intra-database similarity D_DB x r (paper, section III-B).

#include <cstdint>
#include <vector>

#include "common/vocabulary/vocabulary.h"

namespace panofix {

struct SimilarityOptions {
  int num_similar = 32;    // r: rows kept a view
  int dist_max = 48;       // appearance radius in view index steps along the road (paper: 48 or 64)
  double dist_max_m = 80;  // and in metres, where panoramas have no links
  void Check() const;      // throws std::invalid_argument
};

// Row i of D_DB x r: views[offsets[i] .. offsets[i + 1]), most similar first, equals by index.
struct SimilarityIndex {
  std::vector<std::uint32_t> offsets;
  std::vector<std::uint32_t> views;
  std::vector<float> similarity;
};

// Panoramas within the appearance radius of each, itself included, ascending. "Index steps along
// the road" are link hops times the views a panorama; a panorama without links takes those within
// dist_max_m. positions_in_map: metres.
[[nodiscard]] std::vector<std::vector<std::uint32_t>> AppearanceNeighbourhoods(
    const std::vector<std::vector<std::uint32_t>>& links,
    const std::vector<std::array<double, 3>>& positions_in_map, int views_per_panorama,
    const SimilarityOptions& options);

// The r most similar views of views [begin, end) among the views of their panoramas'
// neighbourhoods, themselves left out: one row each. Time is linear in the views at a fixed radius;
// TBB-parallel, deterministic.
[[nodiscard]] SimilarityIndex SimilarityRows(
    const std::vector<BagOfWords>& bags, const std::vector<std::uint32_t>& panorama_of_view,
    const std::vector<std::vector<std::uint32_t>>& neighbourhoods, const SimilarityOptions& options,
    std::size_t begin, std::size_t end);

}  // namespace panofix
