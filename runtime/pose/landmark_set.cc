#include "runtime/pose/landmark_set.h"

#include <algorithm>
#include <cmath>

#include "common/geometry/attitude.h"

namespace panofix {
namespace {

// Whether a view shares directions with the camera: their axes are less than both half diagonals
// apart.
bool LooksAlong(const MapView& view, const Rigid3& local_from_pano, const Eigen::Vector3d& axis,
                double half_fov) {
  const Eigen::Matrix3d pano_from_cam =
      EnuFromBody({view.yaw_deg, view.pitch_deg, 0}) * BodyFromCam();
  const Eigen::Vector3d view_axis = local_from_pano.rotation * pano_from_cam.col(2);
  return axis.dot(view_axis) > std::cos(std::min(3.1, 2.2 * half_fov));
}

}  // namespace

std::vector<ReadyLandmark> CollectLandmarks(const MapBundle& bundle, const StationGrid& stations,
                                            const LocalFrame& local, const Camera& camera,
                                            const Rigid3& cam_from_local,
                                            const LandmarkSetOptions& options) {
  const Eigen::Vector3d camera_in_map = local.ToMap(cam_from_local.Inverse().translation);
  const Eigen::Vector3d axis = cam_from_local.rotation.conjugate() * Eigen::Vector3d::UnitZ();
  const double half_fov = std::atan(0.5 * camera.width_px / camera.fx_px);
  std::vector<std::pair<std::uint32_t, std::uint32_t>> ids;  // landmark, view
  for (const std::uint32_t s :
       stations.Near(camera_in_map, options.max_distance_m, options.num_stations)) {
    const std::uint32_t first = s * bundle.views_per_station();
    const Rigid3 local_from_pano =
        local.LocalFromPano(bundle.panoramas()[bundle.stations()[s].panorama_idx]);
    for (std::uint32_t v = first; v < first + bundle.views_per_station(); ++v) {
      if (!LooksAlong(bundle.views()[v], local_from_pano, axis, half_fov)) continue;
      const MapBundle::LandmarkList list = bundle.LandmarksOf(v);
      for (std::size_t i = 0; i < list.size(); ++i) ids.emplace_back(list[i], v);
    }
  }
  std::sort(ids.begin(), ids.end());
  ids.erase(std::unique(ids.begin(), ids.end(),
                        [](const auto& a, const auto& b) { return a.first == b.first; }),
            ids.end());
  std::vector<ReadyLandmark> ready;
  ready.reserve(ids.size());
  std::uint32_t anchor = ~0U;  // landmarks of one anchor follow each other
  Rigid3 local_from_anchor;
  for (const auto& [id, view] : ids) {
    const MapLandmark landmark = bundle.Landmark(id);
    if (landmark.panorama_idx != anchor) {
      anchor = landmark.panorama_idx;
      local_from_anchor = local.LocalFromPano(bundle.panoramas()[anchor]);
    }
    ReadyLandmark& r = ready.emplace_back();
    r.match = MakeLandmark(bundle, view, id, landmark, local_from_anchor);
    r.id = id;
    r.size_m = static_cast<float>(landmark.size_m);
    r.angle_deg = static_cast<float>(landmark.angle_deg);
    r.up_in_local = (local_from_anchor.rotation * Eigen::Vector3d::UnitZ()).cast<float>();
    bundle.Descriptor(id, r.descriptor.data());
  }
  return ready;
}

}  // namespace panofix
