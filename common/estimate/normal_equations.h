#pragma once
// From an information matrix to a covariance, or to the finding that the pose is not determined.

#include <Eigen/Core>
#include <optional>

#include "common/estimate/refine.h"

namespace panofix {

// Inverse of a 6x6 information matrix; empty where it is singular to working precision (all points
// on one line, no matches) or not finite. Judged after scaling the diagonal to one: metres and
// radians do not compare.
[[nodiscard]] std::optional<Matrix6d> InvertInformation(const Matrix6d& information);

}  // namespace panofix
