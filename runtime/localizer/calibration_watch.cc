#include "runtime/localizer/calibration_watch.h"

#include <cmath>

namespace panofix {
namespace {

// What the map's own errors put into one frame's finding, 1 sigma (generated towns: 0.007).
constexpr double kFrameSigma = 0.008;
// Frames see what the one before saw, with the same errors: so many count as one (generated towns,
// 10 Hz: 1 + 2 x the sum of the autocorrelations is 3 to 7).
constexpr double kFramesAsOne = 6;
// Frames fade, so that a camera that was changed is noticed: at most so many count.
constexpr double kMostFrames = 100;
constexpr double kTolerated = 0.01;  // moves poses by less than their usual sigma
constexpr double kSigmas = 1.5;

}  // namespace

void CalibrationWatch::Add(const FocalCheck& check) {
  const double variance = kFramesAsOne * (check.sigma * check.sigma + kFrameSigma * kFrameSigma);
  if (!std::isfinite(check.error) || !std::isfinite(variance)) return;
  const double most = kMostFrames / (kFramesAsOne * kFrameSigma * kFrameSigma);
  if (information_ > most) {
    weighted_error_ *= most / information_;
    information_ = most;
  }
  information_ += 1 / variance;
  weighted_error_ += check.error / variance;
}

FocalCheck CalibrationWatch::Estimate() const {
  if (!(information_ > 0)) return {};
  return {weighted_error_ / information_, 1 / std::sqrt(information_)};
}

bool CalibrationWatch::IsOff() const {
  const FocalCheck estimate = Estimate();
  return std::abs(estimate.error) > kTolerated + kSigmas * estimate.sigma;
}

}  // namespace panofix
