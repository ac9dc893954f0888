#pragma once
// What the service needs of a localizer, so that it can run on another one (tests do).

#include <cstdint>
#include <filesystem>
#include <memory>

#include "common/base/status.h"
#include "common/camera/camera.h"
#include "runtime/localizer/localizer.h"

namespace panofix {

// One camera's localizer; see Localizer for the rules of each call. Used by one thread.
class FrameEngine {
 public:
  virtual ~FrameEngine() = default;
  [[nodiscard]] virtual FrameResult Localize(std::int64_t timestamp_ns, const GrayImage& frame) = 0;
  [[nodiscard]] virtual FrameResult Undecodable(std::int64_t timestamp_ns) const = 0;
  [[nodiscard]] virtual const BundleIdentity& bundle() const = 0;
  [[nodiscard]] virtual const Camera& camera() const = 0;
};

// Opens engines over one bundle.
class EngineSource {
 public:
  virtual ~EngineSource() = default;
  // Camera that the bundle was built for.
  [[nodiscard]] virtual Result<Camera> BundleCamera() = 0;
  [[nodiscard]] virtual Result<std::unique_ptr<FrameEngine>> Open(const Camera& camera) = 0;
};

// Localizers over the bundle in folder `bundle`.
[[nodiscard]] std::unique_ptr<EngineSource> MakeLocalizerSource(const std::filesystem::path& bundle,
                                                                const LocalizerOptions& options);

}  // namespace panofix
