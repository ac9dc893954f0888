#pragma once
// Landmarks that may be seen from a pose, made ready for searches at it and beside it.

#include <array>
#include <cstdint>
#include <vector>

#include "common/camera/camera.h"
#include "common/map/map_bundle.h"
#include "runtime/pose/frame_matches.h"
#include "runtime/pose/station_grid.h"

namespace panofix {

struct LandmarkSetOptions {
  std::size_t num_stations =
      3;  // nearest ones whose landmarks are taken: looks change with the viewpoint
  double max_distance_m = 25;  // of a station from the camera
};

struct ReadyLandmark {
  Correspondence match;         // lacks its bearing; panorama_idx and view_idx are the bundle's
  std::uint32_t id = 0;         // in the bundle
  float size_m = 0;             // of the described region, across the line of sight
  float angle_deg = 0;          // in a level view of its panorama
  Eigen::Vector3f up_in_local;  // of its panorama: what the angle refers to
  std::array<std::uint8_t, kDescriptorSize> descriptor;
};

// Landmarks of the views of the stations nearest to a camera that look its way; each once.
[[nodiscard]] std::vector<ReadyLandmark> CollectLandmarks(
    const MapBundle& bundle, const StationGrid& stations, const LocalFrame& local,
    const Camera& camera, const Rigid3& cam_from_local, const LandmarkSetOptions& options);

}  // namespace panofix
