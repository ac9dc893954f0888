#include "common/features/gradient_pyramid.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "common/base/log.h"

namespace panofix {
namespace {

constexpr int kMinSide = 3;  // pixels of the smallest level that has a gradient

struct FloatImage {
  int width = 0, height = 0;
  std::vector<float> pixels;
  FloatImage(int w, int h)
      : width(w), height(h), pixels(static_cast<std::size_t>(w) * static_cast<std::size_t>(h)) {}
  float* row(int y) {
    return pixels.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(width);
  }
  [[nodiscard]] const float* row(int y) const {
    return pixels.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(width);
  }
};

// atan2(gy, gx) and the norm of one gradient, written for the vectoriser: no branch, no call,
// choices among integers. The angle's polynomial (Abramowitz and Stegun, 4.4.49) is off by at most
// 1e-5 rad, a tenth of a count; the root is Heron's step from the chord of sqrt(1 + s), off by at
// most 1.1e-4.
inline GradientPixel Encode(float gx, float gy) {
  constexpr float kCountsPerRad = static_cast<float>(65536 / (2 * std::numbers::pi));
  constexpr float kCountsPerGrey = static_cast<float>(1 / kGradientNormUnit);
  constexpr float kTiny = 1e-20F;  // keeps 0/0 out
  const float ax = std::abs(gx), ay = std::abs(gy);
  const float longer = ax > ay ? ax : ay, shorter = ax > ay ? ay : ax;
  const float t = shorter / (longer + kTiny), s = t * t;
  const float angle =
      t * (0.9998660F + s * (-0.3302995F + s * (0.1801410F + s * (-0.0851330F + s * 0.0208351F))));
  int turn = static_cast<int>(angle * kCountsPerRad + 0.5F);
  turn = ay > ax ? 16384 - turn : turn;
  turn = gx < 0 ? 32768 - turn : turn;
  turn = gy < 0 ? 65536 - turn : turn;
  const float chord = 1 + 0.41421356F * s;
  const float norm = longer * 0.5F * (chord + (1 + s) / chord);
  const int count = static_cast<int>(norm * kCountsPerGrey + 0.5F);  // at most 361 * 128
  return static_cast<GradientPixel>(count << 16 | (turn & 0xffff));
}

GradientLevel Gradients(const FloatImage& image, double ratio) {
  GradientLevel level{ratio, image.width, image.height, {}};
  level.pixels.resize(image.pixels.size());
  for (int y = 1; y + 1 < image.height; ++y) {
    const float *above = image.row(y - 1), *here = image.row(y), *below = image.row(y + 1);
    GradientPixel* out =
        level.pixels.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width);
#pragma omp simd
    for (int x = 1; x < image.width - 1; ++x) {
      out[x] = Encode(here[x + 1] - here[x - 1], below[x] - above[x]);
    }
  }
  return level;
}

// The source pixels that a pixel sqrt(2) wide covers, and how much of each; weights sum to 1.
struct Coverage {
  std::array<int, 3> source;
  std::array<float, 3> weight;
};

std::vector<Coverage> Coverages(int source_size) {
  const int size = static_cast<int>(source_size / std::numbers::sqrt2);
  std::vector<Coverage> coverages(static_cast<std::size_t>(size));
  for (int i = 0; i < size; ++i) {
    const double from = i * std::numbers::sqrt2, to = from + std::numbers::sqrt2;
    Coverage& c = coverages[static_cast<std::size_t>(i)];
    for (int k = 0; k < 3; ++k) {
      const int source = static_cast<int>(from) + k;
      const double covered = std::min(to, source + 1.0) - std::max(from, 1.0 * source);
      const auto slot = static_cast<std::size_t>(k);
      c.source[slot] = std::min(source, source_size - 1);
      c.weight[slot] = static_cast<float>(std::max(covered, 0.0) / std::numbers::sqrt2);
    }
  }
  return coverages;
}

FloatImage ShrunkBySqrt2(const FloatImage& image) {
  const auto columns = Coverages(image.width), rows = Coverages(image.height);
  FloatImage result(static_cast<int>(columns.size()), static_cast<int>(rows.size()));
  std::vector<float> mean(static_cast<std::size_t>(image.width));
  for (int y = 0; y < result.height; ++y) {
    const auto& [source, w] = rows[static_cast<std::size_t>(y)];
    const float *a = image.row(source[0]), *b = image.row(source[1]), *c = image.row(source[2]);
    for (std::size_t x = 0; x < mean.size(); ++x) mean[x] = w[0] * a[x] + w[1] * b[x] + w[2] * c[x];
    float* out = result.row(y);
    for (std::size_t x = 0; x < columns.size(); ++x) {
      const auto& [s, v] = columns[x];
      out[x] = v[0] * mean[static_cast<std::size_t>(s[0])] +
               v[1] * mean[static_cast<std::size_t>(s[1])] +
               v[2] * mean[static_cast<std::size_t>(s[2])];
    }
  }
  return result;
}

FloatImage Halved(const FloatImage& image) {
  FloatImage result(image.width / 2, image.height / 2);
  for (int y = 0; y < result.height; ++y) {
    const float *a = image.row(2 * y), *b = image.row(2 * y + 1);
    float* out = result.row(y);
    for (int x = 0; x < result.width; ++x) {
      out[x] = 0.25F * (a[2 * x] + a[2 * x + 1] + b[2 * x] + b[2 * x + 1]);
    }
  }
  return result;
}

// The image itself with gradients for level 0, then each level from the one two steps finer: the
// mean of four boxes is the box that covers them.
std::vector<GradientLevel> Levels(FloatImage image) {
  std::vector<GradientLevel> levels;
  const auto has_gradient = [](const FloatImage& i) {
    return std::min(i.width, i.height) >= kMinSide;
  };
  if (!has_gradient(image)) return levels;
  FloatImage next = ShrunkBySqrt2(image);
  for (double ratio = 1; has_gradient(image); ratio *= std::numbers::sqrt2) {
    levels.push_back(Gradients(image, ratio));
    FloatImage after_next = Halved(image);
    image = std::move(next);
    next = std::move(after_next);
  }
  return levels;
}

}  // namespace

GradientPyramid::GradientPyramid(const GrayImage& image) : impl_(std::make_unique<Impl>()) {
  const auto width = static_cast<std::size_t>(std::max(image.width_px, 0));
  const auto height = static_cast<std::size_t>(std::max(image.height_px, 0));
  if (width * height == 0 || image.pixels.size() != width * height) {
    throw std::invalid_argument(Format("an image of %d x %d has %zu pixels", image.width_px,
                                       image.height_px, image.pixels.size()));
  }
  impl_->width_px = image.width_px;
  impl_->height_px = image.height_px;
  FloatImage grey(image.width_px, image.height_px);
  std::copy(image.pixels.begin(), image.pixels.end(), grey.pixels.begin());
  impl_->levels = Levels(std::move(grey));
}

GradientPyramid::~GradientPyramid() = default;
GradientPyramid::GradientPyramid(GradientPyramid&&) noexcept = default;

}  // namespace panofix
