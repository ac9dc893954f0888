#include "runtime/pose/frame_matches.h"

#include <algorithm>

#include "common/geometry/attitude.h"

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

double KeypointSigma_px(float size_px) {
  // SIFT localises to a fraction of its scale; half a pixel is what resampled views allow at best.
  constexpr double kFloor_px = 0.7, kShareOfSize = 0.12;
  return std::max(kFloor_px, kShareOfSize * static_cast<double>(size_px));
}

Correspondence MakeLandmark(const MapBundle& bundle, std::uint32_t view_idx,
                            const ViewFeatures& features, std::size_t feature_idx,
                            const Rigid3& local_from_pano) {
  const Eigen::Vector3d point_in_pano = features.point(feature_idx);
  Correspondence c;
  c.lever_in_map = local_from_pano.rotation * point_in_pano;
  c.point_in_map = local_from_pano.translation + c.lever_in_map;
  c.range_sigma_in_map = c.lever_in_map.normalized() * features.range_sigma_m(feature_idx);
  // The database keypoint is as uncertain as the frame's: a sideways error of the point.
  c.point_sigma_m = KeypointSigma_px(features.keypoints[4 * feature_idx + 2]) /
                    bundle.manifest().camera.fx_px * point_in_pano.norm();
  const std::uint32_t panorama_idx = bundle.views()[view_idx].panorama_idx;
  const std::uint8_t surface_idx = features.surfaces[feature_idx];
  const MapErrors& errors = bundle.manifest().errors;
  // Index 0 is no plane: a raster's points err each by itself.
  if (surface_idx > 0) c.surface_id = static_cast<int>(panorama_idx) * 256 + surface_idx;
  c.surface_normal_in_map =
      local_from_pano.rotation * bundle.SurfaceNormal(panorama_idx, surface_idx);
  c.surface_distance_sigma = errors.range_sigma_share;
  c.surface_normal_sigma_rad = errors.normal_sigma_deg * kRadPerDeg;
  c.panorama_idx = static_cast<int>(panorama_idx);
  c.view_idx = static_cast<int>(view_idx);
  return c;
}

ViewMatches MatchView(const FrameFeatures& frame, const Camera& camera, const MapBundle& bundle,
                      std::uint32_t view_idx, const LocalFrame& local,
                      const MatchOptions& options) {
  ViewMatches result;
  result.view_idx = view_idx;
  const ViewFeatures features = bundle.Features(view_idx);
  const Rigid3 local_from_pano =
      local.LocalFromPano(bundle.panoramas()[bundle.views()[view_idx].panorama_idx]);
  for (const FeatureMatch& m :
       MatchDescriptors(frame.sift.descriptors, features.descriptors, options)) {
    const auto q = static_cast<std::size_t>(m.query_idx);
    Correspondence c = MakeLandmark(bundle, view_idx, features,
                                    static_cast<std::size_t>(m.database_idx), local_from_pano);
    c.bearing_in_cam = frame.bearings[q];
    c.keypoint_sigma = KeypointSigma_px(frame.sift.keypoints[q].size_px) / camera.fx_px;
    result.correspondences.push_back(c);
    result.keypoint_idx.push_back(m.query_idx);
  }
  return result;
}

}  // namespace panofix
