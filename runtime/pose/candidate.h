#pragma once
// From a hypothesis to a candidate pose: refinement, guided rounds, local bundle adjustment.

#include <optional>
#include <set>

#include "common/estimate/pnp.h"
#include "common/map/map_bundle.h"
#include "runtime/pose/match_pool.h"
#include "runtime/pose/pose_options.h"

namespace panofix {

// Everything that a guided search needs beside the pose.
struct Scene {
  const FrameFeatures& frame;
  const KeypointGrid& grid;
  const Camera& camera;
  const MapBundle& bundle;
  const StationGrid& stations;
  const LocalFrame& local;
  const std::vector<PastFrame>& past;  // older first
};

// Spread of pixels over the image: root of the determinant of their covariance, as a share of a
// uniform distribution's. Near 0 for a cluster or a line.
[[nodiscard]] double ImageSpread(const std::vector<Eigen::Vector2d>& px, const Camera& camera);

// The same of a frame's keypoints.
[[nodiscard]] double KeypointSpread(const std::set<int>& keypoints, const FrameFeatures& frame,
                                    const Camera& camera);

// Whose landmarks a pose is made of: those of PoseOptions::landmarks, or of wide_stations.
enum class Reach { kNear, kWide };

// Refinement and guided rounds; where these leave doubt, once more from the best supported pose
// near by. found = false where no pose comes out. Gates are not applied.
[[nodiscard]] PoseOutcome CompletePose(const Scene& scene, const Rigid3& cam_from_local,
                                       const MatchPool& retrieved, const PoseOptions& options,
                                       Reach reach = Reach::kNear);

// Where a search looks for a camera known to lie within `max_distance_m` of a rough pose: twice
// what the gates allow in height and tilt.
[[nodiscard]] PoseBounds BoundsAround(const Rigid3& rough, double max_distance_m,
                                      const PoseOptions& options);

// LO-RANSAC with the minimal solver over matches of any number of views.
[[nodiscard]] RansacResult FindConsensus(const MatchPool& pool, const PoseOptions& options,
                                         const std::optional<PoseBounds>& bounds = {});

// Matches of the landmarks that a predicted pose would show, each looked for within `radius_px`.
[[nodiscard]] MatchPool MatchNear(const Scene& scene, const Rigid3& cam_from_local,
                                  double radius_px, const PoseOptions& options,
                                  Reach reach = Reach::kNear);

}  // namespace panofix
