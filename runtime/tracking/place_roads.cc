#include "runtime/tracking/place_roads.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string>
#include <tuple>

namespace panofix {
namespace {

constexpr double kFarthest_m = 1e9;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Panoramas of one grid cell that a search looks at: all of half as many, so that only absurd
// crowds are cut, and the work is bounded there.
constexpr std::ptrdiff_t kMaxScanned = 128;

void CheckGraph(const PlaceGraph& graph) {
  const auto& positions = graph.positions_in_map;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    // Written so that NaN fails.
    if (!(positions[i].cwiseAbs().maxCoeff() <= kFarthest_m) || !positions[i].allFinite()) {
      throw std::invalid_argument("positions_in_map[" + std::to_string(i) +
                                  "]; must be finite and within 1e9 m");
    }
  }
  if (!graph.links.empty() && graph.links.size() != positions.size()) {
    throw std::invalid_argument("links of " + std::to_string(graph.links.size()) +
                                " panoramas; must be of all " + std::to_string(positions.size()) +
                                ", or none");
  }
  for (std::size_t i = 0; i < graph.links.size(); ++i) {
    for (const std::uint32_t to : graph.links[i]) {
      if (to >= positions.size()) {
        throw std::invalid_argument("links[" + std::to_string(i) + "] holds " + std::to_string(to) +
                                    "; must be below " + std::to_string(positions.size()));
      }
    }
  }
}

// Panoramas by square cell of the ground.
class Grid {
 public:
  Grid(const std::vector<Eigen::Vector3d>& positions, double cell_m) : cell_m_(cell_m) {
    for (std::uint32_t i = 0; i < positions.size(); ++i) {
      const auto [column, row] = CellOf(positions[i]);
      entries_.push_back({column, row, i});
    }
    std::sort(entries_.begin(), entries_.end());
  }

  // Panoramas of the 3 x 3 cells around a panorama, kMaxScanned of a cell at most: in its own cell
  // those next to it in order, so that a crowd stays joined.
  void Around(const Eigen::Vector3d& position, std::uint32_t place_idx,
              std::vector<std::uint32_t>* found) const {
    found->clear();
    const auto [column, row] = CellOf(position);
    for (std::int64_t c = column - 1; c <= column + 1; ++c) {
      for (std::int64_t r = row - 1; r <= row + 1; ++r) {
        const bool own = c == column && r == row;
        auto from =
            std::lower_bound(entries_.begin(), entries_.end(), Entry{c, r, own ? place_idx : 0});
        if (own) from -= std::min<std::ptrdiff_t>(kMaxScanned / 2, from - entries_.begin());
        const auto to = from + std::min<std::ptrdiff_t>(kMaxScanned, entries_.end() - from);
        for (auto entry = from; entry != to; ++entry) {
          if (entry->column == c && entry->row == r) found->push_back(entry->place_idx);
        }
      }
    }
  }

 private:
  struct Entry {
    std::int64_t column, row;
    std::uint32_t place_idx;
    bool operator<(const Entry& o) const {
      return std::tie(column, row, place_idx) < std::tie(o.column, o.row, o.place_idx);
    }
  };
  [[nodiscard]] std::array<std::int64_t, 2> CellOf(const Eigen::Vector3d& position) const {
    return {static_cast<std::int64_t>(std::floor(position.x() / cell_m_)),
            static_cast<std::int64_t>(std::floor(position.y() / cell_m_))};
  }
  double cell_m_;
  std::vector<Entry> entries_;
};

}  // namespace

PlaceRoads::PlaceRoads(const PlaceGraph& graph, double near_m) {
  CheckGraph(graph);
  const auto& positions = graph.positions_in_map;
  std::vector<bool> is_linked(positions.size());
  const auto join = [&](std::uint32_t a, std::uint32_t b) {
    if (a == b) return;
    const double length_m = (positions[a] - positions[b]).norm();
    edges_.push_back({a, b, length_m});
    edges_.push_back({b, a, length_m});
  };
  for (std::uint32_t i = 0; i < graph.links.size(); ++i) {
    for (const std::uint32_t to : graph.links[i]) {
      join(i, to);
      is_linked[i] = is_linked[to] = true;
    }
  }
  std::vector<std::uint32_t> around;
  std::vector<Reached> near;
  for (const bool linked : {true, false}) {
    const double radius_m = linked ? near_m : std::max(near_m, kUnlinkedReach_m);
    const Grid grid(positions, std::max(radius_m, 1.0));
    for (std::uint32_t i = 0; i < positions.size(); ++i) {
      if (is_linked[i] != linked) continue;
      grid.Around(positions[i], i, &around);
      near.clear();
      for (const std::uint32_t other : around) {
        const double distance_m = (positions[other] - positions[i]).norm();
        if (other != i && distance_m <= radius_m) near.push_back({other, distance_m});
      }
      std::sort(near.begin(), near.end(), [](const Reached& a, const Reached& b) {
        return std::tie(a.distance_m, a.place_idx) < std::tie(b.distance_m, b.place_idx);
      });
      near.resize(std::min(near.size(), kMaxNear));
      for (const Reached& other : near) join(i, other.place_idx);
    }
  }
  const auto ends = [](const Edge& e) { return std::tie(e.from_idx, e.to_idx); };
  std::sort(edges_.begin(), edges_.end(),
            [&](const Edge& a, const Edge& b) { return ends(a) < ends(b); });
  edges_.erase(std::unique(edges_.begin(), edges_.end(),
                           [&](const Edge& a, const Edge& b) { return ends(a) == ends(b); }),
               edges_.end());
  first_edge_.assign(positions.size() + 1, 0);
  for (const Edge& edge : edges_) ++first_edge_[edge.from_idx + 1];
  for (std::size_t i = 0; i < positions.size(); ++i) first_edge_[i + 1] += first_edge_[i];
  distance_m_.assign(positions.size(), kInfinity);
}

// Dijkstra's search with a heap of possibly outdated entries.
std::span<const PlaceRoads::Reached> PlaceRoads::Within(std::uint32_t source_idx, double limit_m,
                                                        std::size_t most) {
  const auto farther = [](const Reached& a, const Reached& b) {
    return std::tie(a.distance_m, a.place_idx) > std::tie(b.distance_m, b.place_idx);
  };
  std::vector<std::uint32_t> touched{source_idx};
  reached_.clear();
  heap_.assign(1, {source_idx, 0});
  distance_m_[source_idx] = 0;
  while (!heap_.empty() && reached_.size() < most) {
    std::pop_heap(heap_.begin(), heap_.end(), farther);
    const Reached at = heap_.back();
    heap_.pop_back();
    if (at.distance_m > distance_m_[at.place_idx]) continue;
    reached_.push_back(at);
    for (std::uint32_t e = first_edge_[at.place_idx]; e < first_edge_[at.place_idx + 1]; ++e) {
      const Reached next{edges_[e].to_idx, at.distance_m + edges_[e].length_m};
      if (next.distance_m > limit_m || next.distance_m >= distance_m_[next.place_idx]) continue;
      if (distance_m_[next.place_idx] == kInfinity) touched.push_back(next.place_idx);
      distance_m_[next.place_idx] = next.distance_m;
      heap_.push_back(next);
      std::push_heap(heap_.begin(), heap_.end(), farther);
    }
  }
  for (const std::uint32_t place : touched) distance_m_[place] = kInfinity;
  return reached_;
}

}  // namespace panofix
