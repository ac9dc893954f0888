#pragma once
// The pose by what the last frames saw, where the map shows too little: a rebuilt house, a lorry, a
// gap in its coverage.

#include <vector>

#include "runtime/pose/pose_estimator.h"
#include "runtime/pose/recent_frames.h"

namespace panofix {

// From predictions, likeliest first: points of the last frames are looked for, whatever landmarks
// of the map are found join them, and one adjustment weighs both, the keyframe's own uncertainty
// included. The covariance grows from frame to frame by that and by a share of the way. Trusted
// where every gate holds; support and over_chance are of the recent points.
[[nodiscard]] PoseOutcome BridgePose(const PoseContext& context, const RecentPoints& recent,
                                     const std::vector<Rigid3>& predictions);

}  // namespace panofix
