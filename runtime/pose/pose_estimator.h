#pragma once
// The frame's pose from all its views' matches: per-view search, guided search, refinement, local
// bundle adjustment, gates.

#include <functional>
#include <vector>

#include "common/map/map_bundle.h"
#include "runtime/pose/frame_matches.h"
#include "runtime/pose/match_pool.h"
#include "runtime/pose/pose_options.h"

namespace panofix {

// What a frame is localized with.
struct PoseContext {
  const FrameFeatures& frame;
  const Camera& camera;
  const MapBundle& bundle;
  const StationGrid& stations;
  const LocalFrame& local;
  const PoseOptions& options;
  // What the past says of a place: belief, in [0, 1], that the vehicle is near a position of the
  // map.
  std::function<double(const Eigen::Vector3d& position_in_map)> prior;
  // Last fixes that join the final adjustment, older first.
  std::vector<PastFrame> past = {};
  // cam_from_local of finds shortly before that were not sure: a find that is not sure either is
  // looked for there too.
  std::vector<Rigid3> last_finds = {};
};

// From retrieved views, matched in the context's local frame. Of look-alikes the one that the past
// speaks for is taken, or none. Deterministic; never throws on data.
[[nodiscard]] PoseOutcome EstimatePose(const PoseContext& context,
                                       const std::vector<ViewMatches>& views);

// From predictions alone, likeliest first: landmarks are looked for around where they must be. The
// first pose that passes every gate is taken. Needs guided matching.
[[nodiscard]] PoseOutcome TrackPose(const PoseContext& context,
                                    const std::vector<Rigid3>& predictions);

// The highest support among poses that lie elsewhere than `own`, searched around `roughs`
// (cam_from_local). Where the map has a second of what the frame shows, as high as the pose's own.
// The past has no say in it: it may have led astray.
[[nodiscard]] double SupportElsewhere(const PoseContext& context, const PoseOutcome& own,
                                      const std::vector<Rigid3>& roughs);

}  // namespace panofix
