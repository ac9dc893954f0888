#pragma once
// The frame's pose from all its views' matches: per-view search, guided search, refinement, local
// bundle adjustment, gates.

#include <vector>

#include "common/map/map_bundle.h"
#include "runtime/pose/frame_matches.h"
#include "runtime/pose/pose_options.h"

namespace panofix {

// `views` are matched in the frame `local`. `predictions` (cam_from_local, likeliest first) are
// tried where the matches lead to no trusted pose; they pass the same gates. Deterministic; never
// throws on data.
[[nodiscard]] PoseOutcome EstimatePose(const std::vector<ViewMatches>& views,
                                       const std::vector<Rigid3>& predictions,
                                       const FrameFeatures& frame, const Camera& camera,
                                       const MapBundle& bundle, const LocalFrame& local,
                                       const PoseOptions& options);

}  // namespace panofix
