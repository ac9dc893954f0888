#include "builder/similarity/similarity_index.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "common/base/log.h"

namespace panofix {
namespace {

// Breadth first along the links up to `hops`.
std::vector<std::uint32_t> WithinHops(const std::vector<std::vector<std::uint32_t>>& links,
                                      std::uint32_t start, int hops) {
  std::vector<std::uint32_t> found{start};
  std::size_t begin = 0;
  for (int hop = 0; hop < hops; ++hop) {
    const std::size_t end = found.size();
    for (std::size_t i = begin; i < end; ++i) {
      for (const std::uint32_t next : links[found[i]]) {
        if (std::find(found.begin(), found.end(), next) == found.end()) found.push_back(next);
      }
    }
    begin = end;
  }
  return found;
}

// Panoramas by cell of `size_m`, for range queries without all pairs.
class Grid {
 public:
  Grid(const std::vector<std::array<double, 3>>& positions, double size_m)
      : positions_(positions), size_m_(size_m) {
    for (std::uint32_t i = 0; i < positions.size(); ++i) cells_[Cell(positions[i])].push_back(i);
  }
  void AppendWithin(std::uint32_t centre, double radius_m,
                    std::vector<std::uint32_t>* found) const {
    const auto [cx, cy] = Cell(positions_[centre]);
    for (std::int64_t x = cx - 1; x <= cx + 1; ++x) {
      for (std::int64_t y = cy - 1; y <= cy + 1; ++y) {
        const auto cell = cells_.find({x, y});
        if (cell == cells_.end()) continue;
        for (const std::uint32_t i : cell->second) {
          if (std::hypot(positions_[i][0] - positions_[centre][0],
                         positions_[i][1] - positions_[centre][1]) <= radius_m) {
            found->push_back(i);
          }
        }
      }
    }
  }

 private:
  std::pair<std::int64_t, std::int64_t> Cell(const std::array<double, 3>& p) const {
    return {static_cast<std::int64_t>(std::floor(p[0] / size_m_)),
            static_cast<std::int64_t>(std::floor(p[1] / size_m_))};
  }
  const std::vector<std::array<double, 3>>& positions_;
  double size_m_;
  std::map<std::pair<std::int64_t, std::int64_t>, std::vector<std::uint32_t>> cells_;
};

}  // namespace

void SimilarityOptions::Check() const {
  if (num_similar < 1 || num_similar > 10000) {
    throw std::invalid_argument(Format("num_similar = %d; must lie in 1..10000", num_similar));
  }
  if (dist_max < 1)
    throw std::invalid_argument(Format("dist_max = %d; must be at least 1", dist_max));
  if (!(dist_max_m > 0))
    throw std::invalid_argument(Format("dist_max_m = %g; must be above 0", dist_max_m));
}

std::vector<std::vector<std::uint32_t>> AppearanceNeighbourhoods(
    const std::vector<std::vector<std::uint32_t>>& links,
    const std::vector<std::array<double, 3>>& positions_in_map, int views_per_panorama,
    const SimilarityOptions& options) {
  options.Check();
  const int hops = std::max(1, options.dist_max / std::max(1, views_per_panorama));
  const Grid grid(positions_in_map, options.dist_max_m);
  std::vector<std::vector<std::uint32_t>> neighbourhoods(links.size());
  for (std::uint32_t i = 0; i < links.size(); ++i) {
    if (links[i].empty()) {
      grid.AppendWithin(i, options.dist_max_m, &neighbourhoods[i]);
    } else {
      neighbourhoods[i] = WithinHops(links, i, hops);
    }
    std::sort(neighbourhoods[i].begin(), neighbourhoods[i].end());
  }
  return neighbourhoods;
}

SimilarityIndex SimilarityRows(const std::vector<BagOfWords>& bags,
                               const std::vector<std::uint32_t>& panorama_of_view,
                               const std::vector<std::vector<std::uint32_t>>& neighbourhoods,
                               const SimilarityOptions& options, std::size_t begin,
                               std::size_t end) {
  options.Check();
  std::vector<std::vector<std::uint32_t>> views_of_panorama(neighbourhoods.size());
  for (std::uint32_t v = 0; v < panorama_of_view.size(); ++v)
    views_of_panorama[panorama_of_view[v]].push_back(v);

  std::vector<std::vector<std::pair<float, std::uint32_t>>> rows(end - begin);
  tbb::parallel_for(begin, end, [&](std::size_t v) {
    auto& row = rows[v - begin];
    for (const std::uint32_t panorama : neighbourhoods[panorama_of_view[v]]) {
      for (const std::uint32_t other : views_of_panorama[panorama]) {
        if (other != v) row.emplace_back(-Similarity(bags[v], bags[other]), other);
      }
    }
    const std::size_t keep = std::min(row.size(), static_cast<std::size_t>(options.num_similar));
    std::partial_sort(row.begin(), row.begin() + static_cast<std::ptrdiff_t>(keep), row.end());
    row.resize(keep);
  });

  SimilarityIndex index;
  index.offsets.push_back(0);
  for (const auto& row : rows) {
    for (const auto& [negative, view] : row) {
      index.views.push_back(view);
      index.similarity.push_back(-negative);
    }
    index.offsets.push_back(static_cast<std::uint32_t>(index.views.size()));
  }
  return index;
}

}  // namespace panofix
