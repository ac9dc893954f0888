#include "builder/augment/hole_filler.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace panofix {
namespace {

constexpr float kUnknown = -1;
constexpr float kMidGrey = 128;

// Grey values, kUnknown where nothing is known.
struct Layer {
  int width = 0, height = 0;
  std::vector<float> values;
  [[nodiscard]] float& At(int x, int y) {
    return values[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                  static_cast<std::size_t>(x)];
  }
};

// Means of the known among each 2x2 values.
Layer Pull(Layer& fine) {
  Layer coarse{(fine.width + 1) / 2, (fine.height + 1) / 2, {}};
  coarse.values.reserve(static_cast<std::size_t>(coarse.width) *
                        static_cast<std::size_t>(coarse.height));
  for (int y = 0; y < coarse.height; ++y) {
    for (int x = 0; x < coarse.width; ++x) {
      float sum = 0, count = 0;
      for (int fy = 2 * y; fy < std::min(2 * y + 2, fine.height); ++fy) {
        for (int fx = 2 * x; fx < std::min(2 * x + 2, fine.width); ++fx) {
          const float value = fine.At(fx, fy);
          if (value != kUnknown) sum += value, count += 1;
        }
      }
      coarse.values.push_back(count > 0 ? sum / count : kUnknown);
    }
  }
  return coarse;
}

// Fills the unknown from a whole coarser layer, bilinear.
void Push(Layer& coarse, Layer& fine) {
  for (int y = 0; y < fine.height; ++y) {
    // Three quarters of the cell that holds the pixel, a quarter of the next one on its side.
    const int y0 = y / 2, y1 = std::clamp(y0 + (y % 2 == 0 ? -1 : 1), 0, coarse.height - 1);
    for (int x = 0; x < fine.width; ++x) {
      float& value = fine.At(x, y);
      if (value != kUnknown) continue;
      const int x0 = x / 2, x1 = std::clamp(x0 + (x % 2 == 0 ? -1 : 1), 0, coarse.width - 1);
      value = 0.75F * (0.75F * coarse.At(x0, y0) + 0.25F * coarse.At(x1, y0)) +
              0.25F * (0.75F * coarse.At(x0, y1) + 0.25F * coarse.At(x1, y1));
    }
  }
}

}  // namespace

void FillHoles(std::span<const std::uint16_t> labels, GrayImage& image) {
  if (std::find(labels.begin(), labels.end(), 0) == labels.end()) return;
  std::vector<Layer> layers(1);
  layers[0] = {image.width_px, image.height_px, {}};
  layers[0].values.reserve(labels.size());
  for (std::size_t i = 0; i < labels.size(); ++i) {
    layers[0].values.push_back(labels[i] == 0 ? kUnknown : static_cast<float>(image.pixels[i]));
  }
  while (layers.back().values.size() > 1) layers.push_back(Pull(layers.back()));
  if (layers.back().values[0] == kUnknown) layers.back().values[0] = kMidGrey;
  for (std::size_t l = layers.size() - 1; l > 0; --l) Push(layers[l], layers[l - 1]);
  for (std::size_t i = 0; i < labels.size(); ++i) {
    if (labels[i] == 0) {
      image.pixels[i] = static_cast<std::uint8_t>(std::lround(layers[0].values[i]));
    }
  }
}

}  // namespace panofix
