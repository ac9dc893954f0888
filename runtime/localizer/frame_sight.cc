#include "runtime/localizer/frame_sight.h"

#include <optional>

#include "runtime/pose/frame_matches.h"

namespace panofix {
namespace {

std::optional<Eigen::Vector2f> InPicture(const Camera& camera, const Eigen::Vector3d& x_in_cam) {
  const auto px = camera.Project(x_in_cam);
  if (!px || px->x() < 0 || px->y() < 0 || px->x() > camera.width_px - 1 ||
      px->y() > camera.height_px - 1) {
    return std::nullopt;
  }
  return px->cast<float>();
}

}  // namespace

FrameSight SightOf(const PoseOutcome& outcome, const LocalFrame& local, const MapBundle& bundle,
                   const Camera& camera) {
  const MapView& view = bundle.views()[outcome.best_view];
  FrameSight sight;
  sight.panorama = bundle.panoramas()[view.panorama_idx].id;
  sight.yaw_deg = view.yaw_deg;
  sight.from_panorama_m = bundle.stations()[view.station_idx].position_in_pano.norm();
  sight.width_px = camera.width_px, sight.height_px = camera.height_px;
  const Camera view_camera = bundle.manifest().camera.WithoutDistortion();
  const Rigid3 view_from_local = PoseOfView(bundle, local, outcome.best_view);
  for (const Correspondence& match : outcome.agreed) {
    const auto frame_px = InPicture(camera, match.bearing_in_cam.homogeneous());
    const auto view_px = InPicture(view_camera, view_from_local * match.point_in_map);
    if (frame_px && view_px) sight.pairs.push_back({*frame_px, *view_px});
  }
  const MapBundle::LandmarkList shown = bundle.LandmarksOf(outcome.best_view);
  for (std::size_t i = 0; i < shown.size(); ++i) {
    const MapLandmark landmark = bundle.Landmark(shown[i]);
    const Rigid3 local_from_anchor = local.LocalFromPano(bundle.panoramas()[landmark.panorama_idx]);
    const auto px =
        InPicture(view_camera, view_from_local * (local_from_anchor * landmark.point_in_pano));
    if (px) sight.landmarks_px.push_back(*px);
  }
  return sight;
}

}  // namespace panofix
