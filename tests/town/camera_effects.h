#pragma once
// From linear light to the bytes a sensor delivers: blur, vignette, exposure, noise and tone.

#include <cstdint>
#include <vector>

#include "tests/town/renderer.h"

namespace panofix::town {

// Blue, green, red; row-major: what OpenCV writes.
struct ByteImage {
  int width = 0, height = 0;
  std::vector<std::uint8_t> bgr;
};

struct CameraEffects {
  float exposure = 1;
  Rgb white_balance{1, 1, 1};
  float gamma = 2.2f;
  float vignette = 0;  // loss in the corners, share
  float defocus_sigma_px = 0;
  float motion_px = 0;     // length of horizontal smear
  float motion_slope = 0;  // rise of the smear, pixels a pixel
  float shot_noise = 0,
        read_noise = 0;  // sigma at full scale, and in the dark, share of full scale
  std::uint32_t noise_seed = 0;
};

// Smears and defocuses in place, in linear light.
void Blur(LinearImage& image, const CameraEffects& effects);
// Exposure that brings the mean brightness to a camera's target.
[[nodiscard]] float AutoExposure(const LinearImage& image);
// Develops rows starting at `first_row` of a picture `width` x `height`; writes 3 * width bytes a
// row.
void Develop(const Rgb* linear, int width, int height, int first_row, int num_rows,
             const CameraEffects& effects, std::uint8_t* bgr);

}  // namespace panofix::town
