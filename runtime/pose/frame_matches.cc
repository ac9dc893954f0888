#include "runtime/pose/frame_matches.h"

#include <algorithm>
#include <cmath>

#include "common/geometry/attitude.h"

namespace panofix {

double KeypointSigma_px(float size_px) {
  // SIFT localises to a fraction of its scale; half a pixel is what resampled views allow at best.
  constexpr double kFloor_px = 0.7, kShareOfSize = 0.12;
  return std::max(kFloor_px, kShareOfSize * static_cast<double>(size_px));
}

Correspondence MakeLandmark(const MapBundle& bundle, std::uint32_t view_idx,
                            std::uint32_t landmark_id, const MapLandmark& landmark,
                            const Rigid3& local_from_anchor) {
  Correspondence c;
  c.lever_in_map = local_from_anchor.rotation * landmark.point_in_pano;
  c.point_in_map = local_from_anchor.translation + c.lever_in_map;
  const double plane_sigma_m =
      landmark.surface_idx > 0 ? kPlaneRangeShare * c.lever_in_map.norm() : 0;
  c.range_sigma_in_map =
      c.lever_in_map.normalized() * std::hypot(landmark.range_sigma_m, plane_sigma_m);
  c.point_sigma_m = landmark.point_sigma_m;
  if (landmark.surface_idx > 0) {
    const MapSurface surface = bundle.SurfaceOf(landmark_id, landmark);
    c.surface_id = static_cast<int>(landmark.panorama_idx) * 256 + landmark.surface_idx;
    c.surface_normal_in_map = local_from_anchor.rotation * surface.normal_in_pano;
    c.surface_distance_sigma = surface.distance_sigma_share;
    c.surface_normal_sigma_rad = surface.normal_sigma_rad;
  }
  c.panorama_idx = static_cast<int>(landmark.panorama_idx);
  c.view_idx = static_cast<int>(view_idx);
  return c;
}

void ViewMatches::Append(const ViewMatches& other) {
  correspondences.insert(correspondences.end(), other.correspondences.begin(),
                         other.correspondences.end());
  keypoint_idx.insert(keypoint_idx.end(), other.keypoint_idx.begin(), other.keypoint_idx.end());
  landmark_ids.insert(landmark_ids.end(), other.landmark_ids.begin(), other.landmark_ids.end());
}

Rigid3 PoseOfView(const MapBundle& bundle, const LocalFrame& local, std::uint32_t view_idx) {
  const MapView& view = bundle.views()[view_idx];
  const Rigid3 pano_from_cam(EnuFromBody({view.yaw_deg, view.pitch_deg, 0}) * BodyFromCam(),
                             bundle.stations()[view.station_idx].position_in_pano);
  return (local.LocalFromPano(bundle.panoramas()[view.panorama_idx]) * pano_from_cam).Inverse();
}

ViewMatches MatchView(const FrameFeatures& frame, const Camera& camera, const MapBundle& bundle,
                      std::uint32_t view_idx, const LocalFrame& local,
                      const MatchOptions& options) {
  ViewMatches result;
  result.view_idx = view_idx;
  const MapBundle::LandmarkList landmarks = bundle.LandmarksOf(view_idx);
  std::vector<std::uint8_t> descriptors(landmarks.size() * kDescriptorSize);
  for (std::size_t i = 0; i < landmarks.size(); ++i)
    bundle.Descriptor(landmarks[i], &descriptors[i * kDescriptorSize]);
  for (const FeatureMatch& m : MatchDescriptors(frame.sift.descriptors, descriptors, options)) {
    const auto q = static_cast<std::size_t>(m.query_idx);
    const std::uint32_t id = landmarks[static_cast<std::size_t>(m.database_idx)];
    const MapLandmark landmark = bundle.Landmark(id);
    Correspondence c = MakeLandmark(bundle, view_idx, id, landmark,
                                    local.LocalFromPano(bundle.panoramas()[landmark.panorama_idx]));
    c.bearing_in_cam = frame.bearings[q];
    c.keypoint_sigma = KeypointSigma_px(frame.sift.keypoints[q].size_px) / camera.fx_px;
    result.correspondences.push_back(c);
    result.keypoint_idx.push_back(m.query_idx);
    result.landmark_ids.push_back(id);
  }
  return result;
}

}  // namespace panofix
