#pragma once
// Descriptors of the line between two points of an image; private to kVLD.

#include <array>
#include <cstdint>

#include "common/features/kvld.h"

namespace panofix {

inline constexpr int kMaxLineSamples = 32, kMaxLineSubBins = 16, kMaxLineOrientationBins = 64;

// Section 2 of the paper. Discs at equal steps between the ends, overlapping by half; each has a
// histogram of its gradients' directions relative to the line, and a main one.
struct LineDescriptor {
  // num_samples x num_sub_bins, sum 1; and by disc.
  std::array<float, kMaxLineSamples * kMaxLineSubBins> histogram;
  std::array<int, kMaxLineSamples> orientation_bin;
  std::array<float, kMaxLineSamples> weight;  // of a main direction over its opposite, sum 1
  double contrast = 0;  // 0 where the image is flat or ends, or the line too long for the pyramid
};

// Points are pixels of the image, in any order of magnitude: discs outside it are empty.
[[nodiscard]] LineDescriptor DescribeLine(const GradientPyramid& image, double x0_px, double y0_px,
                                          double x1_px, double y1_px, const KvldOptions& options);

// Distance of two lines, 0 for equal ones; infinite where either has no or too much contrast.
[[nodiscard]] double LineDistance(const LineDescriptor& a, const LineDescriptor& b,
                                  const KvldOptions& options);

}  // namespace panofix
