#pragma once
// What a frame and the view of the map that shows most of it have in common, for a person to look
// at. Computed where LocalizerOptions::with_sight asks for it.

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "common/camera/camera.h"
#include "common/map/map_bundle.h"
#include "runtime/pose/pose_options.h"

namespace panofix {

// A map keeps no pictures: a view is shown by its landmarks, drawn into its image plane (of the
// map's camera, without distortion).
struct FrameSight {
  std::string panorama;
  double yaw_deg = 0;               // of the view, from the panorama's heading
  double from_panorama_m = 0;       // of the view's station
  int width_px = 0, height_px = 0;  // of frame and view
  struct Pair {
    Eigen::Vector2f frame_px, view_px;
  };
  std::vector<Pair> pairs;  // keypoints that agree with the pose, where the view shows them too
  std::vector<Eigen::Vector2f> landmarks_px;  // all that the view shows
};

// REQUIRES: outcome.found, in frame `local`. `camera` took the frame.
[[nodiscard]] FrameSight SightOf(const PoseOutcome& outcome, const LocalFrame& local,
                                 const MapBundle& bundle, const Camera& camera);

}  // namespace panofix
