#pragma once
// Which landmarks of different panoramas are one surface point. Private to the module.

#include <utility>

#include "builder/landmarks/layer_types.h"

namespace panofix {

// Matches along known geometry: landmarks of neighbouring panoramas whose points agree within the
// errors of poses and depths, alike in size, angle and descriptor, each the other's best, clearly
// better than any other place, and in agreement with their plane pair's median offset. Panoramas
// marked in `is_excluded` take no part. Ascending by landmark; panorama pairs in parallel.
[[nodiscard]] std::vector<TrackMatch> MatchLandmarks(const LayerInput& input,
                                                     const MergedLandmarks& merged,
                                                     const std::vector<bool>& is_excluded);

// Joins matches into tracks, the most alike first; a join that would put two landmarks of a
// panorama into one track is left out. In order of their first members.
[[nodiscard]] std::vector<Track> JoinTracks(std::vector<TrackMatch> matches);

// Pairs (a < b) of panoramas near enough to see the same surfaces, ascending; pairs of two fixed
// ones are left out.
[[nodiscard]] std::vector<std::pair<std::uint32_t, std::uint32_t>> NeighbourPairs(
    const LayerInput& input, const std::vector<bool>& is_excluded);

// Squared deviation of two landmarks' points by their errors (chi square, 3 degrees of freedom),
// the range errors capped: what far, oblique planes say proves nothing.
struct PlacedLandmark {
  Eigen::Vector3f point_in_local, ray_in_local;
  float range_m = 0, range_sigma_m = 0;
  float other_sigma_m = 0;  // each axis: geotag, heading, keypoint
  float size_m = 0, angle_deg = 0;
  std::uint8_t surface_idx = 0;
};
inline constexpr float kMaxDeviationSq = 12;  // 99.3 % of chi square with 3 degrees of freedom
[[nodiscard]] float DeviationSq(const PlacedLandmark& a, const PlacedLandmark& b);
[[nodiscard]] PlacedLandmark Place(const LayerInput& input, const Landmark& landmark);
[[nodiscard]] bool AlikeInShape(const PlacedLandmark& a, const PlacedLandmark& b);

}  // namespace panofix
