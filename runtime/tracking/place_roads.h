#pragma once
// The roads between panoramas, and what lies within a distance along them.

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace panofix {

// Where the panoramas stand and how they are linked.
struct PlaceGraph {
  std::vector<Eigen::Vector3d> positions_in_map;  // metres
  // Neighbours along the road, of each panorama; empty as a whole where the map has none. Roads
  // lead both ways, whichever end names the link.
  std::vector<std::vector<std::uint32_t>> links;
};

// Links, and edges to what stands near by straight distance: two passes of one street need not be
// linked, a panorama without any link must be reachable all the same. An edge is as long as its
// straight line. Memory and time to build grow with panoramas and links. Not thread-safe: Within
// uses the object's work space.
class PlaceRoads {
 public:
  struct Reached {
    std::uint32_t place_idx = 0;
    double distance_m = 0;  // along the roads
  };
  // What stands within `near_m` is joined, and so is what stands within kUnlinkedReach_m of a
  // panorama without links; to the kMaxNear nearest each. Throws std::invalid_argument where a
  // position is not finite or beyond 1e9 m, or a link leads nowhere.
  PlaceRoads(const PlaceGraph& graph, double near_m);
  [[nodiscard]] std::size_t size() const { return first_edge_.size() - 1; }
  // What lies within `limit_m` of `source_idx` by road, itself first, nearest first (equals by
  // index), at most `most`. The span holds until the next call.
  [[nodiscard]] std::span<const Reached> Within(std::uint32_t source_idx, double limit_m,
                                                std::size_t most);

  static constexpr double kUnlinkedReach_m = 50;
  static constexpr std::size_t kMaxNear = 16;

 private:
  struct Edge {
    std::uint32_t from_idx = 0, to_idx = 0;
    double length_m = 0;
  };
  std::vector<Edge> edges_;                // both ways, by from_idx, then to_idx
  std::vector<std::uint32_t> first_edge_;  // of each panorama, and the end
  std::vector<double> distance_m_;         // best so far; infinite outside a search
  std::vector<Reached> heap_, reached_;
};

}  // namespace panofix
