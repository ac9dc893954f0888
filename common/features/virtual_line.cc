#include "common/features/virtual_line.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>
#include <tuple>

#include "common/features/gradient_pyramid.h"

namespace panofix {
namespace {

constexpr double kMinRadiusPx = 2;    // of a disc in the image
constexpr double kLevelRadiusPx = 5;  // a disc this large or up to sqrt(2) more, at its level
constexpr std::size_t kMaxDiscColumns = 16;  // 2 * 7.08 + 1

// exp(-d2 / (4.5 r^2)) for d2 <= r^2, to 5e-6.
float Gaussian(float d2_over_r2) {
  const float u = d2_over_r2 * (1 / 4.5F);
  return 1 - u * (1 - u * (1 / 2.0F) * (1 - u * (1 / 3.0F) * (1 - u * (1 / 4.0F))));
}

int Floor(float v) {  // without SSE 4.1 std::floor is a call
  const int i = static_cast<int>(v);
  return i - static_cast<int>(static_cast<float>(i) > v);
}
int Ceil(float v) { return -Floor(-v); }

// Sums by bin in four lanes: neighbouring pixels tend to the same bin, and would wait for each
// other.
constexpr int kNumLanes = 2;
using LanedHistogram = std::array<float, (kMaxLineOrientationBins + 1) * kNumLanes>;

// Adds a disc's gradients, weighed by norm and nearness, to `histogram` by their turn from
// `line_turn`. Bin i is centred at i / num_bins of a circle; bin num_bins is the first one again.
// Rows of the square around the disc, pixels outside it weighing nothing, in fours: the
// vectoriser's form. The last four may reach past `to_x`, where there is a border pixel and another
// row.
void AddDisc(const GradientLevel& level, float x, float y, float radius, int line_turn,
             int num_bins, LanedHistogram* histogram) {
  const int from_x = std::max(1, Ceil(x - radius));
  const int to_x = std::min(level.width_px - 2, Floor(x + radius));
  const int from_y = std::max(1, Ceil(y - radius));
  const int to_y = std::min(level.height_px - 2, Floor(y + radius));
  if (from_x > to_x) return;
  const float r2 = radius * radius, scale = 1 / r2;
  const int num_columns = (to_x - from_x + 4) / 4 * 4;
  std::array<float, kMaxDiscColumns> dx2, column_weight, weight;
  std::array<int, kMaxDiscColumns> slot;
  for (int i = 0; i < num_columns; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const float dx = static_cast<float>(from_x + i) - x;
    dx2[at] = dx * dx;
    column_weight[at] = from_x + i <= to_x ? Gaussian(dx2[at] * scale) : 0;
  }
  for (int row = from_y; row <= to_y; ++row) {
    const float dy = static_cast<float>(row) - y;
    const float row_weight = Gaussian(dy * dy * scale), max_dx2 = r2 - dy * dy;
    const GradientPixel* pixels =
        level.pixels.data() +
        static_cast<std::size_t>(row) * static_cast<std::size_t>(level.width_px) +
        static_cast<std::size_t>(from_x);
#pragma omp simd
    for (int i = 0; i < num_columns; ++i) {
      const auto at = static_cast<std::size_t>(i);
      const int turn = (GradientTurn(pixels[i]) - line_turn) & 0xffff;
      slot[at] = ((turn * num_bins + 32768) >> 16) * kNumLanes + i % kNumLanes;
      const int is_inside = dx2[at] <= max_dx2 ? 1 : 0;
      weight[at] =
          row_weight * column_weight[at] * static_cast<float>(is_inside * GradientNorm(pixels[i]));
    }
    for (std::size_t at = 0; at < static_cast<std::size_t>(num_columns); ++at) {
      (*histogram)[static_cast<std::size_t>(slot[at])] += weight[at];
    }
  }
}

using Histogram = std::array<float, kMaxLineOrientationBins>;

Histogram DiscHistogram(const GradientLevel& level, float x, float y, float radius, int line_turn,
                        std::size_t num_bins) {
  LanedHistogram lanes;
  std::fill_n(lanes.begin(), (num_bins + 1) * kNumLanes, 0.0F);
  AddDisc(level, x, y, radius, line_turn, static_cast<int>(num_bins), &lanes);
  Histogram histogram;
  const auto sum_of = [&](std::size_t bin) {
    const float* lane = lanes.data() + bin * kNumLanes;
    return lane[0] + lane[1];
  };
  for (std::size_t bin = 0; bin < num_bins; ++bin) histogram[bin] = sum_of(bin);
  histogram[0] += sum_of(num_bins);
  return histogram;
}

// The bin that most exceeds its opposite, and by how much.
std::pair<int, float> MainOrientation(const Histogram& histogram, std::size_t num_bins) {
  const std::size_t half = num_bins / 2;
  std::size_t best = 0;
  float best_excess = 0;
  for (std::size_t i = 0; i < half; ++i) {
    const float excess = histogram[i] - histogram[i + half];
    if (std::abs(excess) > best_excess) {
      best = excess > 0 ? i : i + half;
      best_excess = std::abs(excess);
    }
  }
  return {static_cast<int>(best), best_excess};
}

// An odd number of orientation bins make a sub-bin, so that they share its centre and edges.
void ToSubBins(const Histogram& histogram, std::size_t num_bins, std::size_t num_sub_bins,
               float* sub_bins) {
  const std::size_t per_sub_bin = num_bins / num_sub_bins, half = per_sub_bin / 2;
  std::size_t bin = num_bins - half;
  for (std::size_t sub_bin = 0; sub_bin < num_sub_bins; ++sub_bin) {
    float sum = 0;
    for (std::size_t i = 0; i < per_sub_bin; ++i) {
      sum += histogram[bin < num_bins ? bin : bin - num_bins];
      ++bin;
    }
    if (sub_bin == 0) bin = half + 1;
    sub_bins[sub_bin] = sum;
  }
}

// Makes the sum 1 where it is above 0, and returns what it was.
float Normalize(std::span<float> values) {
  float sum = 0;
  for (const float v : values) sum += v;
  if (!(sum > 0)) return 0;
  const float scale = 1 / sum;
  for (float& v : values) v *= scale;
  return sum;
}

// The finest level at which a disc is at most sqrt(2) * kLevelRadiusPx.
const GradientLevel* LevelFor(const GradientPyramid& image, double radius_px) {
  for (const GradientLevel& level : image.impl().levels) {
    if (radius_px <= kLevelRadiusPx * std::numbers::sqrt2 * level.ratio) return &level;
  }
  return nullptr;
}

}  // namespace

LineDescriptor DescribeLine(const GradientPyramid& image, double x0_px, double y0_px, double x1_px,
                            double y1_px, const KvldOptions& options) {
  LineDescriptor line;
  const double dx_px = x1_px - x0_px, dy_px = y1_px - y0_px;
  const double length_px = std::hypot(dx_px, dy_px);
  const double radius_px = std::max(length_px / (options.num_samples + 1), kMinRadiusPx);
  const GradientLevel* level = LevelFor(image, radius_px);
  if (level == nullptr || !(length_px > 0)) return line;

  const double turn = std::atan2(dy_px, dx_px) / (2 * std::numbers::pi);
  const int line_turn = static_cast<int>(std::lround(65536 * turn));
  const auto num_samples = static_cast<std::size_t>(options.num_samples);
  const auto num_sub_bins = static_cast<std::size_t>(options.num_sub_bins);
  const auto num_bins = static_cast<std::size_t>(options.num_orientation_bins);
  const float radius = static_cast<float>(radius_px / level->ratio);
  for (std::size_t i = 0; i < num_samples; ++i) {
    const double t = (static_cast<double>(i) + 1) / (options.num_samples + 1);
    const auto at_level = [&](double from_px, double step_px) {
      const double at = (from_px + t * step_px + 0.5) / level->ratio - 0.5;
      return static_cast<float>(std::clamp(at, -1e6, 1e6));  // far outside; keeps Floor in range
    };
    const Histogram bins = DiscHistogram(*level, at_level(x0_px, dx_px), at_level(y0_px, dy_px),
                                         radius, line_turn, num_bins);
    std::tie(line.orientation_bin[i], line.weight[i]) = MainOrientation(bins, num_bins);
    ToSubBins(bins, num_bins, num_sub_bins, line.histogram.data() + i * num_sub_bins);
  }
  Normalize({line.histogram.data(), num_samples * num_sub_bins});
  line.contrast =
      Normalize({line.weight.data(), num_samples}) * kGradientNormUnit * level->ratio / length_px;
  return line;
}

double LineDistance(const LineDescriptor& a, const LineDescriptor& b, const KvldOptions& options) {
  if (!(std::min(a.contrast, b.contrast) > 0) ||
      std::max(a.contrast, b.contrast) > options.max_contrast) {
    return std::numeric_limits<double>::infinity();
  }
  const auto num_samples = static_cast<std::size_t>(options.num_samples);
  const auto num_values = num_samples * static_cast<std::size_t>(options.num_sub_bins);
  float contrast = 0, orientation = 0;
  for (std::size_t i = 0; i < num_values; ++i)
    contrast += std::abs(a.histogram[i] - b.histogram[i]);
  for (std::size_t i = 0; i < num_samples; ++i) {
    const int difference = std::abs(a.orientation_bin[i] - b.orientation_bin[i]);
    orientation +=
        static_cast<float>(std::min(difference, options.num_orientation_bins - difference)) *
        (a.weight[i] + b.weight[i]);
  }
  return options.contrast_weight * contrast +
         options.orientation_weight * orientation / options.num_orientation_bins;
}

}  // namespace panofix
