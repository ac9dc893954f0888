#pragma once
// Whether the camera's stated focal length suits what the frames show, over many of them.

#include "common/estimate/focal_check.h"

namespace panofix {

// A calibration holds from frame to frame, so their findings add up. One of a few per cent off
// shifts poses by a metre with residuals that look well.
class CalibrationWatch {
 public:
  // A trusted frame's finding.
  void Add(const FocalCheck& check);
  // Relative error of the focal length so far, and its 1-sigma.
  [[nodiscard]] FocalCheck Estimate() const;
  // The error is there and too large to stand by the poses' stated sigmas.
  [[nodiscard]] bool IsOff() const;

 private:
  double information_ = 0, weighted_error_ = 0;
};

}  // namespace panofix
