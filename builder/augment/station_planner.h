#pragma once
// Where virtual panoramas are rendered: stations along the links, and beside them on the lanes.

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "common/map/map_bundle.h"

namespace panofix {

struct StationOptions {
  double spacing_m = 2.5;               // along a link; 0 = no stations but the panoramas
  std::vector<double> lanes_m = {0.0};  // offsets to the right of the way from one panorama to next
  double beyond_m = 5;                  // past a panorama with one link only: the road goes on
  double max_link_m = 30;               // longer links say nothing of the street between
  void Check() const;                   // throws std::invalid_argument naming field, value and rule
};

// A viewpoint of the map. Its axes are those of its panorama's pano frame.
struct Station {
  std::uint32_t panorama_idx = 0;
  Eigen::Vector3d position_in_pano = Eigen::Vector3d::Zero();  // metres
};

// Stations of every panorama, those of panorama p at [p]: first the panorama itself (offset zero),
// then the virtual ones that lie nearer to it than to the link's other end (a tie goes to the lower
// id). What is planned at a panorama depends on it and its linked neighbours only, so that shards
// agree. Heights follow the line between the two panoramas.
[[nodiscard]] std::vector<std::vector<Station>> PlanStations(
    const std::vector<MapPanorama>& panoramas, const StationOptions& options);

}  // namespace panofix
