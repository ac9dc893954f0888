#include "runtime/pose/station_grid.h"

#include <algorithm>
#include <cmath>

#include "common/map/local_frame.h"

namespace panofix {
namespace {

std::int64_t CellOf(double x, double cell_m) {
  return static_cast<std::int64_t>(std::floor(x / cell_m));
}
std::int64_t Key(std::int64_t column, std::int64_t row) {
  return column * (std::int64_t{1} << 32) + row;
}

}  // namespace

StationGrid::StationGrid(const MapBundle& bundle) {
  for (std::uint32_t s = 0; s < bundle.stations().size(); ++s) {
    const MapStation& station = bundle.stations()[s];
    const MapPanorama& panorama = bundle.panoramas()[station.panorama_idx];
    const LocalFrame local = LocalFrame::At(panorama);
    positions_in_map_.push_back(
        local.ToMap(local.LocalFromPano(panorama) * station.position_in_pano));
    const Eigen::Vector3d& p = positions_in_map_.back();
    cells_[Key(CellOf(p.x(), kCell_m), CellOf(p.y(), kCell_m))].push_back(s);
  }
}

std::vector<std::uint32_t> StationGrid::Near(const Eigen::Vector3d& x_in_map, double radius_m,
                                             std::size_t most) const {
  std::vector<std::pair<double, std::uint32_t>> near;
  if (!x_in_map.allFinite()) return {};
  const std::int64_t x0 = CellOf(x_in_map.x() - radius_m, kCell_m),
                     x1 = CellOf(x_in_map.x() + radius_m, kCell_m);
  const std::int64_t y0 = CellOf(x_in_map.y() - radius_m, kCell_m),
                     y1 = CellOf(x_in_map.y() + radius_m, kCell_m);
  for (std::int64_t x = x0; x <= x1; ++x) {
    for (std::int64_t y = y0; y <= y1; ++y) {
      const auto cell = cells_.find(Key(x, y));
      if (cell == cells_.end()) continue;
      for (const std::uint32_t s : cell->second) {
        const double distance_m = (positions_in_map_[s] - x_in_map).head<2>().norm();
        if (distance_m <= radius_m) near.emplace_back(distance_m, s);
      }
    }
  }
  std::sort(near.begin(), near.end());
  std::vector<std::uint32_t> stations;
  for (std::size_t i = 0; i < std::min(near.size(), most); ++i) stations.push_back(near[i].second);
  return stations;
}

}  // namespace panofix
