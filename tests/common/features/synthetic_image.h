#pragma once
// Grey images with known content.

#include <algorithm>
#include <cmath>
#include <vector>

#include "common/base/rng.h"
#include "common/image/gray_image.h"

namespace panofix {

struct Blob {
  double x_px = 0, y_px = 0, sigma_px = 3, amplitude = 100;
};

// Sum of Gaussians on grey 110, rounded; pixel centres at integers.
inline GrayImage BlobImage(int width_px, int height_px, const std::vector<Blob>& blobs) {
  std::vector<double> values(static_cast<std::size_t>(width_px * height_px), 110.0);
  for (const Blob& b : blobs) {
    const double reach_px = 5 * b.sigma_px;  // beyond, less than a thousandth of a grey level
    const auto from = [&](double c) { return std::max(0, static_cast<int>(c - reach_px)); };
    const auto to = [&](double c, int size) {
      return std::min(size, static_cast<int>(c + reach_px) + 2);
    };
    for (int y = from(b.y_px); y < to(b.y_px, height_px); ++y) {
      for (int x = from(b.x_px); x < to(b.x_px, width_px); ++x) {
        const double r2 = std::pow(x - b.x_px, 2) + std::pow(y - b.y_px, 2);
        values[static_cast<std::size_t>(y * width_px + x)] +=
            b.amplitude * std::exp(-0.5 * r2 / (b.sigma_px * b.sigma_px));
      }
    }
  }
  GrayImage image{width_px, height_px, {}};
  for (const double v : values) {
    image.pixels.push_back(static_cast<std::uint8_t>(std::lround(std::clamp(v, 0.0, 255.0))));
  }
  return image;
}

// Blobs of many sizes and both signs everywhere: something to find at every scale.
inline GrayImage BusyImage(int width_px, int height_px, std::uint64_t seed) {
  Rng rng(seed, "tests/busy_image");
  std::vector<Blob> blobs;
  for (int i = 0; i < width_px * height_px / 400; ++i) {
    const double sign = rng.Below(2) == 0 ? -1 : 1;
    blobs.push_back({rng.Uniform(0, width_px), rng.Uniform(0, height_px), rng.Uniform(1.2, 6),
                     sign * rng.Uniform(30, 110)});
  }
  return BlobImage(width_px, height_px, blobs);
}

}  // namespace panofix
