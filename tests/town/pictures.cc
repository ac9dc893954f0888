// Pictures as each day's camera delivers them.
#include <tbb/parallel_for.h>

#include "common/base/rng.h"
#include "tests/town/writer.h"

namespace panofix::town {

ByteImage RenderPanorama(const Town& town, std::size_t index) {
  const TownOptions& options = town.options();
  const PanoramaPose& pose = town.layout().panoramas[index];
  const Light light = DrawLight(options, Day::kMap);
  Rng rng(options.seed, "effects/" + pose.id);
  CameraEffects effects;
  effects.exposure = light.exposure * static_cast<float>(1 + 0.05 * rng.Normal());
  effects.white_balance = light.white_balance;
  effects.shot_noise = 0.008f;
  effects.read_noise = 0.002f;
  effects.noise_seed = static_cast<std::uint32_t>(rng());
  const int width = options.pano_width_px, height = width / 2;
  ByteImage image{width, height,
                  std::vector<std::uint8_t>(3 * static_cast<std::size_t>(width) *
                                            static_cast<std::size_t>(height))};
  constexpr int kStripRows = 64;  // fixed, so that no thread count moves a ray
  tbb::parallel_for(0, (height + kStripRows - 1) / kStripRows, [&](int strip) {
    const int row0 = strip * kStripRows, row1 = std::min(height, row0 + kStripRows);
    std::vector<Rgb> linear(static_cast<std::size_t>(width) *
                            static_cast<std::size_t>(row1 - row0));
    town.renderer(Day::kMap).PanoramaRows(pose.town_from_pano, width, row0, row1, linear.data());
    Develop(
        linear.data(), width, height, row0, row1 - row0, effects,
        image.bgr.data() + 3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(row0));
  });
  return image;
}

ByteImage RenderFrame(const Town& town, std::size_t index) {
  const TownOptions& options = town.options();
  const FramePose& pose = town.layout().frames[index];
  LinearImage linear = town.renderer(Day::kDrive).Frame(pose.town_from_cam, town.camera());
  Rng rng(options.seed, "effects/frame/" + std::to_string(index));
  CameraEffects effects;
  const Light light = DrawLight(options, Day::kDrive);
  effects.white_balance = light.white_balance;
  effects.defocus_sigma_px = static_cast<float>(rng.Uniform(0.3, 0.6));
  effects.motion_px = static_cast<float>(std::abs(rng.Normal()) * 0.9);
  effects.motion_slope = static_cast<float>(0.3 * rng.Normal());
  effects.noise_seed = static_cast<std::uint32_t>(rng());
  if (options.same_light) {
    effects.exposure = light.exposure;
    effects.shot_noise = 0.008f, effects.read_noise = 0.002f;
    effects.motion_px = 0;
  } else {
    effects.exposure = AutoExposure(linear) * static_cast<float>(1 + 0.08 * rng.Normal());
    effects.gamma = 2.0f;
    effects.vignette = 0.3f;
    effects.shot_noise = 0.02f, effects.read_noise = 0.004f;
  }
  Blur(linear, effects);
  ByteImage image{linear.width, linear.height, std::vector<std::uint8_t>(3 * linear.pixels.size())};
  Develop(linear.pixels.data(), linear.width, linear.height, 0, linear.height, effects,
          image.bgr.data());
  return image;
}

}  // namespace panofix::town
