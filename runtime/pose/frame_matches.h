#pragma once
// A frame's 2D-3D matches against chosen database views, in a local metric frame.

#include <cstdint>
#include <span>
#include <vector>

#include "common/camera/camera.h"
#include "common/estimate/correspondence.h"
#include "common/features/features.h"
#include "common/features/matcher.h"
#include "common/map/map_bundle.h"

namespace panofix {

// The frame's features with their undistorted bearings.
struct FrameFeatures {
  FeatureSet sift;
  std::vector<Eigen::Vector2d> bearings;    // (x/z, y/z)
  double smallest_px = kSmallestRegion_px;  // landmarks that appear smaller cannot be found in it
};

// Error of a keypoint in pixels, 1-sigma: grows with the region's size.
[[nodiscard]] double KeypointSigma_px(float size_px);

// 1-sigma error of the range of a landmark that only a depth plane places, beside what the map
// states, as a share of it: what stands before a façade (a tree, a car) was put on the façade's
// plane, and no second panorama has told.
inline constexpr double kPlaneRangeShare = 0.1;

// A landmark as a correspondence that still lacks its bearing: the point, its errors and its lever,
// in the local frame. `view_idx` is one that shows it.
[[nodiscard]] Correspondence MakeLandmark(const MapBundle& bundle, std::uint32_t view_idx,
                                          std::uint32_t landmark_id, const MapLandmark& landmark,
                                          const Rigid3& local_from_anchor);

// Matches of one view; correspondences' panorama_idx and view_idx are the bundle's.
struct ViewMatches {
  std::uint32_t view_idx = 0;
  std::vector<Correspondence> correspondences;
  std::vector<int> keypoint_idx;            // of the frame, one a correspondence
  std::vector<std::uint32_t> landmark_ids;  // likewise
  void Append(const ViewMatches& other);
};

// cam_from_local of a view of the map.
[[nodiscard]] Rigid3 PoseOfView(const MapBundle& bundle, const LocalFrame& local,
                                std::uint32_t view_idx);

[[nodiscard]] ViewMatches MatchView(const FrameFeatures& frame, const Camera& camera,
                                    const MapBundle& bundle, std::uint32_t view_idx,
                                    const LocalFrame& local, const MatchOptions& options);

}  // namespace panofix
