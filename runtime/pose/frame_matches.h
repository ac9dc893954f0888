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

// A metric frame near the vehicle: x_in_map = origin + scale (x, y) and z unchanged, so that
// lengths in it are true ground lengths whatever the grid's point scale.
struct LocalFrame {
  Eigen::Vector3d origin_in_map = Eigen::Vector3d::Zero();
  double point_scale = 1;
  [[nodiscard]] static LocalFrame At(const MapPanorama& panorama);
  [[nodiscard]] Eigen::Vector3d FromMap(const Eigen::Vector3d& x_in_map) const;
  [[nodiscard]] Eigen::Vector3d ToMap(const Eigen::Vector3d& x_in_local) const;
  [[nodiscard]] Rigid3 LocalFromPano(const MapPanorama& panorama) const;
};

// The frame's features with their undistorted bearings.
struct FrameFeatures {
  FeatureSet sift;
  std::vector<Eigen::Vector2d> bearings;  // (x/z, y/z)
};

// Error of a keypoint in pixels, 1-sigma: grows with the region's size.
[[nodiscard]] double KeypointSigma_px(float size_px);

// Feature `feature_idx` of a view's `features` as a correspondence that still lacks its bearing:
// the point, its errors and its lever, in the local frame.
[[nodiscard]] Correspondence MakeLandmark(const MapBundle& bundle, std::uint32_t view_idx,
                                          const ViewFeatures& features, std::size_t feature_idx,
                                          const Rigid3& local_from_pano);

// Matches of one view; correspondences' panorama_idx and view_idx are the bundle's.
struct ViewMatches {
  std::uint32_t view_idx = 0;
  std::vector<Correspondence> correspondences;
  std::vector<int> keypoint_idx;  // of the frame, one a correspondence
};

[[nodiscard]] ViewMatches MatchView(const FrameFeatures& frame, const Camera& camera,
                                    const MapBundle& bundle, std::uint32_t view_idx,
                                    const LocalFrame& local, const MatchOptions& options);

}  // namespace panofix
