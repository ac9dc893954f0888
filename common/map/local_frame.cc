#include "common/map/local_frame.h"

#include "common/map/map_bundle.h"

namespace panofix {

LocalFrame LocalFrame::At(const MapPanorama& panorama) {
  return {panorama.map_from_pano.translation, panorama.point_scale};
}

Eigen::Vector3d LocalFrame::FromMap(const Eigen::Vector3d& x_in_map) const {
  const Eigen::Vector3d d = x_in_map - origin_in_map;
  return {d.x() / point_scale, d.y() / point_scale, d.z()};
}

Eigen::Vector3d LocalFrame::ToMap(const Eigen::Vector3d& x_in_local) const {
  return origin_in_map + Eigen::Vector3d(x_in_local.x() * point_scale, x_in_local.y() * point_scale,
                                         x_in_local.z());
}

Rigid3 LocalFrame::LocalFromPano(const MapPanorama& panorama) const {
  return {panorama.map_from_pano.rotation, FromMap(panorama.map_from_pano.translation)};
}

}  // namespace panofix
