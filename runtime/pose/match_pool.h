#pragma once
// All views' matches as one set, and what agrees with a pose.

#include <Eigen/Core>
#include <vector>

#include "common/estimate/correspondence.h"
#include "common/estimate/refine.h"
#include "runtime/pose/frame_matches.h"

namespace panofix {

// Matches of all views, with their keypoints.
struct MatchPool {
  std::vector<Correspondence> matches;
  std::vector<int> keypoint_idx;
  void Append(const ViewMatches& view);
};

// A past fix with the matches that it rests on, in the local frame of the frame at hand.
struct PastFrame {
  Rigid3 cam_from_local;
  std::vector<Correspondence> matches;
};

// Whether a match's residual lies within its own covariance (99 %) and 12 px; its chi-square if so.
[[nodiscard]] bool Agrees(const Correspondence& match, const Rigid3& cam_from_local,
                          double focal_px, double* chi2);
// The matches that agree with a pose, in their order.
[[nodiscard]] MatchPool Agreeing(const MatchPool& pool, const Rigid3& cam_from_local,
                                 double focal_px);
// Distinct keypoints with a match that agrees.
[[nodiscard]] int CountKeypoints(const MatchPool& pool, const Rigid3& cam_from_local,
                                 double focal_px);
// Overlapping views of one panorama repeat a point: of each (keypoint, panorama) the match that
// agrees best stays, or its noise would count twice.
[[nodiscard]] MatchPool WithoutRepeats(const MatchPool& pool, const Rigid3& cam_from_local,
                                       double focal_px);
// The priors of the panoramas that vouch for the matches, ascending.
[[nodiscard]] std::vector<PanoramaPrior> PriorsOf(const MatchPool& pool, const MapErrors& errors);
// The camera's position.
[[nodiscard]] inline Eigen::Vector3d CentreOf(const Rigid3& cam_from_local) {
  return cam_from_local.Inverse().translation;
}

}  // namespace panofix
