#pragma once
// kVLD: keeps matches that agree with their neighbours along virtual lines (Z. Liu and R. Marlet,
// "Virtual line descriptor and semi-local graph matching method for reliable feature
// correspondence", BMVC 2012).

#include <memory>
#include <span>
#include <vector>

#include "common/features/features.h"
#include "common/features/matcher.h"
#include "common/image/gray_image.h"

namespace panofix {

// Published reference parameters.
struct KvldOptions {
  int min_connected = 3;          // K: gvld-consistent neighbours that a match needs
  int num_samples = 10;           // discs along a line, 1..32
  int num_sub_bins = 8;           // of a disc's gradient histogram, 2..16
  int num_orientation_bins = 24;  // of the vote for a disc's main orientation, up to 64: even, and
                                  // an odd multiple of num_sub_bins
  // Of the histograms' difference and of the main orientations' in the distance of two lines.
  double contrast_weight = 0.36, orientation_weight = 0.64;
  double min_distance_px = 10;  // between two keypoints that make a line
  double max_contrast = 300;    // of a line, grey levels; above it a line is no evidence
  // Share of right matches that neighbourhoods are sized for: a circle holds 3 of them on average.
  // Halved up to five times while fewer than this share is kept.
  double inlier_rate = 0.04;
  // Of a neighbour, between where it is and where a match's scale and turn put it, relative to the
  // line's length; at or above it the two are not geometrically consistent.
  double distance_threshold = 0.5;
  double descriptor_threshold = 0.35;  // of two lines' distance; at or above it they do not match
  void Check() const;                  // throws std::invalid_argument naming field, value and rule
};

// Gradient norms and orientations of an image at the scales lines are described at: steps of sqrt 2
// while both sides have 3 pixels. Computed once an image, shared by all its matchings: 8 bytes a
// pixel, about 10 ns. Immutable, thread-safe. Throws std::invalid_argument where the image's pixels
// are not width x height.
class GradientPyramid {
 public:
  explicit GradientPyramid(const GrayImage& image);
  ~GradientPyramid();
  GradientPyramid(GradientPyramid&&) noexcept;
  struct Impl;
  [[nodiscard]] const Impl& impl() const { return *impl_; }

 private:
  std::unique_ptr<Impl> impl_;
};

// Indices of the matches kept, ascending: each has K neighbours, and no point of an image is left
// with two partners. Matches may be many to many; repeated ones count once, the first is returned.
// Keypoints are pixels of the pyramids' images; one that is not finite makes no match. The ratio of
// two sizes and the difference of two angles are used, so keypoints without either (0 in both
// images) are taken as unscaled and upright. Memory is linear in the matches, and the same matches
// are kept in whatever order they come. A match whose index lies outside its keypoints throws
// std::invalid_argument.
[[nodiscard]] std::vector<int> FilterKvld(const GradientPyramid& query_image,
                                          std::span<const Keypoint> query,
                                          const GradientPyramid& database_image,
                                          std::span<const Keypoint> database,
                                          std::span<const FeatureMatch> matches,
                                          const KvldOptions& options);

}  // namespace panofix
