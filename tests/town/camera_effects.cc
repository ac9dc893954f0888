#include "tests/town/camera_effects.h"

#include <array>
#include <cmath>

namespace panofix::town {
namespace {

constexpr int kToneSteps = 4096;
constexpr float kToneMax = 2;  // linear light at the table's end

// Gamma with a soft shoulder below white.
std::array<float, kToneSteps + 1> ToneTable(float gamma) {
  std::array<float, kToneSteps + 1> table{};
  for (int i = 0; i <= kToneSteps; ++i) {
    const float x = kToneMax * static_cast<float>(i) / kToneSteps;
    constexpr float kKnee = 0.7f;
    const float soft =
        x < kKnee ? x : kKnee + (1 - kKnee) * (1 - std::exp((kKnee - x) / (1 - kKnee)));
    table[static_cast<std::size_t>(i)] = 255 * std::pow(soft, 1 / gamma);
  }
  return table;
}

// Standard normal, near enough: four bytes of a hash summed.
float NearNormal(std::uint32_t h) {
  const std::uint32_t sum = (h & 255u) + ((h >> 8) & 255u) + ((h >> 16) & 255u) + (h >> 24);
  return (static_cast<float>(sum) - 510.0f) * (1 / 147.8f);
}

// Convolves with taps at (k * step_x, k * step_y), k = -n..n, bilinear between rows; edges repeat.
void Convolve(LinearImage& image, const std::vector<float>& taps, float step_x, float step_y) {
  const int n = static_cast<int>(taps.size()) / 2;
  const std::vector<Rgb> source = image.pixels;
  const auto at = [&](int x, int y) {
    x = std::clamp(x, 0, image.width - 1);
    y = std::clamp(y, 0, image.height - 1);
    return source[static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) +
                  static_cast<std::size_t>(x)];
  };
  std::size_t i = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x, ++i) {
      Rgb sum;
      for (int k = -n; k <= n; ++k) {
        const float fx = static_cast<float>(x) + static_cast<float>(k) * step_x;
        const float fy = static_cast<float>(y) + static_cast<float>(k) * step_y;
        const int ix = FloorInt(fx), iy = FloorInt(fy);
        const float sx = fx - static_cast<float>(ix), sy = fy - static_cast<float>(iy);
        Rgb value = at(ix, iy);
        if (sx > 0) value = Mix(value, at(ix + 1, iy), sx);
        if (sy > 0)
          value =
              Mix(value, sx > 0 ? Mix(at(ix, iy + 1), at(ix + 1, iy + 1), sx) : at(ix, iy + 1), sy);
        sum = sum + value * taps[static_cast<std::size_t>(k + n)];
      }
      image.pixels[i] = sum;
    }
  }
}

}  // namespace

void Blur(LinearImage& image, const CameraEffects& effects) {
  if (effects.defocus_sigma_px > 0.05f) {
    const int n = std::max(1, static_cast<int>(std::ceil(2.5f * effects.defocus_sigma_px)));
    std::vector<float> taps;
    float sum = 0;
    for (int k = -n; k <= n; ++k) {
      const float x = static_cast<float>(k) / effects.defocus_sigma_px;
      taps.push_back(std::exp(-0.5f * x * x));
      sum += taps.back();
    }
    for (float& tap : taps) tap /= sum;
    Convolve(image, taps, 1, 0);
    Convolve(image, taps, 0, 1);
  }
  if (effects.motion_px > 0.2f) {
    constexpr int kTaps = 5;
    const float step = effects.motion_px / kTaps;
    Convolve(image, std::vector<float>(kTaps, 1.0f / kTaps), step, step * effects.motion_slope);
  }
}

float AutoExposure(const LinearImage& image) {
  constexpr double kTarget = 0.24;
  double sum = 0;
  for (const Rgb& p : image.pixels) {
    sum += static_cast<double>(std::min(1.2f, 0.3f * p.r + 0.6f * p.g + 0.1f * p.b));
  }
  const double mean = sum / static_cast<double>(std::max<std::size_t>(1, image.pixels.size()));
  return static_cast<float>(std::clamp(kTarget / std::max(1e-6, mean), 0.5, 4.0));
}

void Develop(const Rgb* linear, int width, int height, int first_row, int num_rows,
             const CameraEffects& effects, std::uint8_t* bgr) {
  const auto table = ToneTable(effects.gamma);
  const Rgb gain = effects.white_balance * effects.exposure;
  const float cx = 0.5f * static_cast<float>(width - 1), cy = 0.5f * static_cast<float>(height - 1);
  const float corner = 1 / (cx * cx + cy * cy + 1);
  for (int y = first_row; y < first_row + num_rows; ++y) {
    for (int x = 0; x < width; ++x) {
      const float dx = static_cast<float>(x) - cx, dy = static_cast<float>(y) - cy;
      const float fall = 1 - effects.vignette * (dx * dx + dy * dy) * corner;
      const Rgb c = *linear++ * gain * fall;
      const std::uint32_t hash = HashInt(x, y, effects.noise_seed);
      const float channels[3] = {c.b, c.g, c.r};
      for (std::uint32_t k = 0; k < 3; ++k) {
        const float sigma =
            effects.read_noise + effects.shot_noise * std::sqrt(std::max(0.0f, channels[k]));
        const float value = channels[k] + sigma * NearNormal(Hash(hash, k, 0x5bd1u));
        const float tone = std::clamp(value, 0.0f, kToneMax) * (kToneSteps / kToneMax);
        *bgr++ = static_cast<std::uint8_t>(table[static_cast<std::size_t>(tone)] + 0.5f);
      }
    }
  }
}

}  // namespace panofix::town
