#include "runtime/app/health_probe.h"

#include "runtime/localizer/localizer.h"

namespace panofix {
namespace {

Status Probe(const StoreLayout& layout, const std::filesystem::path& folder) {
  const auto keys = ReadStoreKeys(layout);
  if (!keys.ok()) return keys.status();
  const auto camera = Localizer::ReadBundleCamera(folder);
  if (!camera.ok()) return camera.status();
  LocalizerOptions options;
  options.trusted_keys = keys->ring;
  const auto localizer = Localizer::Open(folder, *camera, options);
  if (!localizer.ok()) return localizer.status();
  GrayImage frame;
  frame.width_px = camera->width_px, frame.height_px = camera->height_px;
  frame.pixels.assign(
      static_cast<std::size_t>(frame.width_px) * static_cast<std::size_t>(frame.height_px), 0);
  const FrameResult result = (*localizer)->Localize(0, frame);
  // An empty frame has an honest answer.
  if (result.reason == "too_few_features") return {};
  return {ErrorCode::kUnhealthy, "an empty frame was answered with '" + result.reason + "'"};
}

}  // namespace

HealthProbe MakeHealthProbe(const StoreLayout& layout, double timeout_s) {
  return [=](const std::filesystem::path& folder) {
    return RunInChild([&] { return Probe(layout, folder); }, timeout_s);
  };
}

}  // namespace panofix
