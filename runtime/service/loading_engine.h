#pragma once
// Stands in while a map is being opened: a large one takes longer than a camera's frames may wait.

#include "runtime/service/frame_engine.h"

namespace panofix {

inline constexpr const char* kMapLoading = "map_loading";

// Answers every frame no_fix, "map_loading", as of no bundle.
class LoadingEngine : public FrameEngine {
 public:
  explicit LoadingEngine(const Camera& camera) : camera_(camera) {}
  FrameResult Localize(std::int64_t timestamp_ns, const GrayImage& /*frame*/,
                       const TimeIsUp& /*time_is_up*/) override {
    return Undecodable(timestamp_ns);
  }
  FrameResult Undecodable(std::int64_t timestamp_ns) const override {
    FrameResult result;
    result.timestamp_ns = timestamp_ns;
    result.reason = kMapLoading;
    return result;
  }
  const BundleIdentity& bundle() const override { return bundle_; }
  const Camera& camera() const override { return camera_; }
  void Forget() override {}
  Result<std::unique_ptr<FrameEngine>> Another() const override {
    return std::unique_ptr<FrameEngine>(std::make_unique<LoadingEngine>(camera_));
  }
  MapFacts facts() const override { return {}; }

 private:
  const Camera camera_;
  const BundleIdentity bundle_;
};

}  // namespace panofix
