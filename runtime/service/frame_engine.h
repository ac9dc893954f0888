#pragma once
// What the service needs of a localizer, so that it can run on another one (tests do).

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "common/base/status.h"
#include "common/camera/camera.h"
#include "runtime/localizer/localizer.h"
#include "runtime/monitor/service_monitor.h"
#include "runtime/retrieval/tile_indices.h"

namespace panofix {

// One camera's localizer; see Localizer for the rules of each call. Used by one thread.
class FrameEngine {
 public:
  virtual ~FrameEngine() = default;
  [[nodiscard]] virtual FrameResult Localize(std::int64_t timestamp_ns, const GrayImage& frame,
                                             const TimeIsUp& time_is_up) = 0;
  [[nodiscard]] virtual FrameResult Undecodable(std::int64_t timestamp_ns) const = 0;
  [[nodiscard]] virtual const BundleIdentity& bundle() const = 0;
  [[nodiscard]] virtual const Camera& camera() const = 0;
  virtual void Forget() = 0;
  // One more over the same open map, for another thread.
  [[nodiscard]] virtual Result<std::unique_ptr<FrameEngine>> Another() const = 0;
  // What a watcher is shown of the map.
  [[nodiscard]] virtual MapFacts facts() const = 0;
  [[nodiscard]] virtual TileMemory memory() const { return {}; }
};

// Opens engines over a map.
class EngineSource {
 public:
  virtual ~EngineSource() = default;
  // Camera that the bundle was built for.
  [[nodiscard]] virtual Result<Camera> BundleCamera() = 0;
  [[nodiscard]] virtual Result<std::unique_ptr<FrameEngine>> Open(const Camera& camera) = 0;
  // Id of the map that is to be used from now on instead of the one opened last; empty where that
  // one stays. Quick.
  [[nodiscard]] virtual std::string NewerMap() { return {}; }
  // Opens the map that was told last. May run in a thread of its own, no other call being made
  // meanwhile. Where it fails, later calls of Open still mean the map before.
  [[nodiscard]] virtual Result<std::unique_ptr<FrameEngine>> OpenUpdate(const Camera& camera) {
    return Open(camera);
  }
};

// Localizers over the bundle in folder `bundle`.
[[nodiscard]] std::unique_ptr<EngineSource> MakeLocalizerSource(const std::filesystem::path& bundle,
                                                                const LocalizerOptions& options);

}  // namespace panofix
