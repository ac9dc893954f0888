#pragma once
// Matching with a pose in hand: landmarks near the camera are projected and looked for where they
// must be.

#include <cstdint>
#include <vector>

#include "common/estimate/correspondence.h"
#include "common/estimate/refine.h"
#include "common/map/map_bundle.h"
#include "runtime/pose/frame_matches.h"

namespace panofix {

struct GuidedOptions {
  int num_panoramas = 4;                         // nearest ones with depth that are asked
  double max_distance_m = 30;                    // of a panorama from the camera
  double min_radius_px = 5, max_radius_px = 12;  // search window; within, 3 sigma of the prediction
  double max_descriptor_distance = 330;  // of RootSIFT bytes; unrelated features lie near 600
  double max_scale_ratio = 1.8;          // between predicted and found keypoint size
  double max_turn_deg = 25;              // between predicted and found keypoint orientation
  double decoy_offset_px = 70;           // how far off the chance windows lie
  double max_viewing_deg = 60;           // between the two lines of sight to a landmark
};

struct GuidedMatches {
  std::vector<ViewMatches> views;  // only those with a match
  int num_visible = 0;             // landmarks that the pose puts in the picture
  int num_found = 0;               // of these, found
  int num_decoys = 0;  // found as well in a window of the same size put elsewhere: chance
};

// Frame keypoints by image cell, for window queries.
class KeypointGrid {
 public:
  KeypointGrid(const FrameFeatures& frame, const Camera& camera);
  // Appends the indices of keypoints within `radius_px`.
  void Within(const Eigen::Vector2d& px, double radius_px, std::vector<int>* found) const;

 private:
  static constexpr int kCell_px = 16;
  const FrameFeatures& frame_;
  int columns_ = 0, rows_ = 0;
  std::vector<std::uint32_t> offsets_;
  std::vector<int> keypoints_;
};

// Landmarks of the panoramas nearest to the pose, searched around their projections. At a right
// pose a good share of the visible ones is found; at a wrong one, nearly none: num_found /
// num_visible is evidence that retrieval and consensus do not share. Needs RootSIFT descriptors.
[[nodiscard]] GuidedMatches MatchGuided(const FrameFeatures& frame, const KeypointGrid& grid,
                                        const Camera& camera, const MapBundle& bundle,
                                        const LocalFrame& local, const Rigid3& cam_from_local,
                                        const Matrix6d& covariance, const GuidedOptions& options);

}  // namespace panofix
