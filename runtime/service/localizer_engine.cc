// The real engine behind the service.

#include "runtime/service/frame_engine.h"
#include "runtime/service/serve.h"

namespace panofix {
namespace {

class LocalizerEngine : public FrameEngine {
 public:
  explicit LocalizerEngine(std::unique_ptr<Localizer> localizer)
      : localizer_(std::move(localizer)) {}
  FrameResult Localize(std::int64_t timestamp_ns, const GrayImage& frame) override {
    return localizer_->Localize(timestamp_ns, frame);
  }
  FrameResult Undecodable(std::int64_t timestamp_ns) const override {
    return localizer_->Undecodable(timestamp_ns);
  }
  const BundleIdentity& bundle() const override { return localizer_->bundle(); }
  const Camera& camera() const override { return localizer_->camera(); }

 private:
  std::unique_ptr<Localizer> localizer_;
};

class LocalizerSource : public EngineSource {
 public:
  LocalizerSource(const std::filesystem::path& bundle, const LocalizerOptions& options)
      : bundle_(bundle), options_(options) {}
  Result<Camera> BundleCamera() override { return Localizer::ReadBundleCamera(bundle_); }
  Result<std::unique_ptr<FrameEngine>> Open(const Camera& camera) override {
    auto localizer = Localizer::Open(bundle_, camera, options_);
    if (!localizer.ok()) return localizer.status();
    return std::unique_ptr<FrameEngine>(std::make_unique<LocalizerEngine>(std::move(*localizer)));
  }

 private:
  const std::filesystem::path bundle_;
  const LocalizerOptions options_;
};

}  // namespace

std::unique_ptr<EngineSource> MakeLocalizerSource(const std::filesystem::path& bundle,
                                                  const LocalizerOptions& options) {
  return std::make_unique<LocalizerSource>(bundle, options);
}

Status Serve(const ServeOptions& options) {
  try {
    options.localizer.Check();
  } catch (const std::invalid_argument& error) {
    return {ErrorCode::kInvalidArgument, error.what()};
  }
  const std::unique_ptr<EngineSource> source =
      MakeLocalizerSource(options.bundle, options.localizer);
  return ServeFrom(options, *source);
}

}  // namespace panofix
