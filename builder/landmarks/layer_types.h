#pragma once
// What the stages of the landmark layer hand to each other. Private to the module.

#include <algorithm>
#include <cmath>
#include <compare>
#include <cstdint>
#include <numbers>
#include <span>
#include <vector>

#include "builder/landmarks/landmark_layer.h"

namespace panofix {

inline constexpr double kRadPerDeg = std::numbers::pi / 180;

// The arguments of BuildLandmarks that every stage wants.
struct LayerInput {
  std::span<const LandmarkPanorama> panoramas;
  MapErrors errors;
  double focal_px = 0;
  LandmarkOptions options;
};

struct MergedLandmark {
  Landmark landmark;
  float response = 0;  // the strongest of its observations
};
using MergedLandmarks = std::vector<std::vector<MergedLandmark>>;  // [panorama][landmark]

struct LandmarkRef {
  std::uint32_t panorama = 0, idx = 0;
  auto operator<=>(const LandmarkRef&) const = default;
};

[[nodiscard]] inline const Landmark& Get(const MergedLandmarks& merged, LandmarkRef ref) {
  return merged[ref.panorama][ref.idx].landmark;
}

// Landmarks of different panoramas that are taken for one surface point and look alike.
struct TrackMatch {
  LandmarkRef a, b;
  int distance_sq = 0;  // of the descriptors
};

// One surface point: ascending by panorama, at most one landmark each.
struct Track {
  std::vector<LandmarkRef> members;
};

// 1-sigma error of a keypoint across its ray, at the surface: a share of the described region, but
// never below what pixels resolve.
[[nodiscard]] inline double KeypointSigma_m(double size_m, double range_m, double focal_px) {
  constexpr double kSizeShare = 0.12, kLeastError_px = 0.7;
  return std::max(kSizeShare * size_m, kLeastError_px * range_m / focal_px);
}

// Difference of two keypoint angles, degrees in [0, 180].
[[nodiscard]] inline double AngleDifference_deg(double a_deg, double b_deg) {
  return std::abs(std::remainder(a_deg - b_deg, 360.0));
}

// Of a landmark's point by the poses given.
[[nodiscard]] inline Eigen::Vector3d InLocal(const LayerInput& input, const Landmark& landmark) {
  return input.panoramas[landmark.panorama].local_from_pano * landmark.point_in_pano.cast<double>();
}

}  // namespace panofix
