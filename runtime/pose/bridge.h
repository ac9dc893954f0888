#pragma once
// The pose by what the last frames saw, where the map shows too little: a rebuilt house, a lorry, a
// gap in its coverage.

#include <vector>

#include "runtime/pose/pose_estimator.h"
#include "runtime/pose/recent_frames.h"

namespace panofix {

// From predictions, likeliest first: points of the last frames are looked for, whatever landmarks
// of the map are found join them, and one adjustment weighs both, the keyframe's own uncertainty
// included. The covariance grows from frame to frame by that and by a share of the way. Gates of
// its own: enough of the points found, spread, residuals, a short step from the keyframe and from
// the prediction, a stated sigma, a plausible place; degraded beyond the map or where the sigma is
// large. Of the outcome, support and over_chance are of the recent points, agreement and coverage
// not set.
[[nodiscard]] PoseOutcome BridgePose(const PoseContext& context, const RecentPoints& recent,
                                     const std::vector<Rigid3>& predictions);

}  // namespace panofix
