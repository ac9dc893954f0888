#pragma once
// Matching with a pose in hand: landmarks near the camera are projected and looked for where they
// must be.

#include <array>
#include <cstdint>
#include <vector>

#include "common/estimate/correspondence.h"
#include "common/estimate/refine.h"
#include "runtime/pose/frame_matches.h"
#include "runtime/pose/keypoint_grid.h"
#include "runtime/pose/landmark_set.h"

namespace panofix {

struct GuidedOptions {
  double min_radius_px = 5, max_radius_px = 12;  // search window; within, 3 sigma of the prediction
  double max_descriptor_distance = 330;  // of RootSIFT bytes; unrelated features lie near 600
  double max_scale_ratio = 1.8;          // between predicted and found keypoint size
  double max_turn_deg = 25;              // between predicted and found keypoint orientation
  double max_ratio = 0.85;               // of MatchAround: best to second best descriptor distance
  double decoy_offset_px = 70;           // how far off the chance windows lie
};

struct GuidedMatches {
  ViewMatches matches;  // its view_idx is of no meaning here
  int num_visible = 0;  // landmarks that the pose puts in the picture
  int num_found = 0;    // of these, found
  int num_decoys = 0;   // found as well in a window of the same size put elsewhere: chance
  // The same by cell of the picture, row by row: a pose that suits one thing only is borne out in
  // the cells of that thing.
  static constexpr int kCellColumns = 6, kCellRows = 4;
  struct Cell {
    int num_visible = 0, num_found = 0, num_decoys = 0;
  };
  std::array<Cell, kCellColumns * kCellRows> cells;
};

// Share of the cells with landmarks to be seen, weighed by their number, where more are found than
// chance gives.
[[nodiscard]] double SupportedShare(const GuidedMatches& matches);

// The keypoints that may show what is predicted, descriptors apart.
[[nodiscard]] KeypointShape ShapeLike(double size_px, double angle_deg,
                                      const GuidedOptions& options);

// Of the candidate keypoints the one nearest in descriptor, unless another one elsewhere comes near
// it (options.max_ratio); or -1.
[[nodiscard]] int BestOfWindow(const FrameFeatures& frame, const std::vector<int>& candidates,
                               const std::uint8_t* descriptor, const GuidedOptions& options);

// Landmarks searched around their projections. At a right pose a good share of the visible ones is
// found; at a wrong one, nearly none: num_found / num_visible is evidence that retrieval and
// consensus do not share. Needs RootSIFT descriptors.
[[nodiscard]] GuidedMatches MatchGuided(const FrameFeatures& frame, const KeypointGrid& grid,
                                        const Camera& camera,
                                        const std::vector<ReadyLandmark>& landmarks,
                                        const Rigid3& cam_from_local, const Matrix6d& covariance,
                                        const GuidedOptions& options);

// Landmarks looked for in wide windows around their projections, where a pose is known to some
// degrees and a metre or two: nearest descriptor, kept where no keypoint elsewhere in the window
// comes near it.
[[nodiscard]] ViewMatches MatchAround(const FrameFeatures& frame, const KeypointGrid& grid,
                                      const Camera& camera,
                                      const std::vector<ReadyLandmark>& landmarks,
                                      const Rigid3& cam_from_local, double radius_px,
                                      const GuidedOptions& options);

}  // namespace panofix
