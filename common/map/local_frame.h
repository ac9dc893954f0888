#pragma once
// A metric frame on a patch of the map.

#include "common/geometry/rigid3.h"

namespace panofix {

struct MapPanorama;

// x_in_map = origin + scale (x, y) and z unchanged, so that lengths in it are true ground lengths
// whatever the grid's point scale.
struct LocalFrame {
  Eigen::Vector3d origin_in_map = Eigen::Vector3d::Zero();
  double point_scale = 1;
  [[nodiscard]] static LocalFrame At(const MapPanorama& panorama);
  [[nodiscard]] Eigen::Vector3d FromMap(const Eigen::Vector3d& x_in_map) const;
  [[nodiscard]] Eigen::Vector3d ToMap(const Eigen::Vector3d& x_in_local) const;
  [[nodiscard]] Rigid3 LocalFromPano(const MapPanorama& panorama) const;
};

}  // namespace panofix
