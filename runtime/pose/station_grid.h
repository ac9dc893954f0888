#pragma once
// Stations of a map by place, for neighbours without a look at all of them.

#include <Eigen/Core>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include "common/map/map_bundle.h"

namespace panofix {

// Immutable, thread-safe.
class StationGrid {
 public:
  explicit StationGrid(const MapBundle& bundle);
  // Stations within `radius_m` of a position, horizontally, nearest first (equals by index), at
  // most `most`.
  [[nodiscard]] std::vector<std::uint32_t> Near(const Eigen::Vector3d& x_in_map, double radius_m,
                                                std::size_t most) const;
  [[nodiscard]] const Eigen::Vector3d& position_in_map(std::uint32_t station_idx) const {
    return positions_in_map_[station_idx];
  }

 private:
  static constexpr double kCell_m = 20;
  std::vector<Eigen::Vector3d> positions_in_map_;
  std::unordered_map<std::int64_t, std::vector<std::uint32_t>> cells_;
};

}  // namespace panofix
