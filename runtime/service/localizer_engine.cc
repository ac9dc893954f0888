// The real engine behind the service.

#include "common/map/map_bundle.h"
#include "runtime/service/frame_engine.h"
#include "runtime/service/serve.h"

namespace panofix {
namespace {

class LocalizerEngine : public FrameEngine {
 public:
  explicit LocalizerEngine(std::unique_ptr<Localizer> localizer)
      : localizer_(std::move(localizer)) {}
  static Result<std::unique_ptr<FrameEngine>> Over(Result<std::unique_ptr<Localizer>> localizer) {
    if (!localizer.ok()) return localizer.status();
    return std::unique_ptr<FrameEngine>(std::make_unique<LocalizerEngine>(std::move(*localizer)));
  }
  FrameResult Localize(std::int64_t timestamp_ns, const GrayImage& frame,
                       const TimeIsUp& time_is_up) override {
    return localizer_->Localize(timestamp_ns, frame, time_is_up);
  }
  FrameResult Undecodable(std::int64_t timestamp_ns) const override {
    return localizer_->Undecodable(timestamp_ns);
  }
  const BundleIdentity& bundle() const override { return localizer_->bundle(); }
  const Camera& camera() const override { return localizer_->camera(); }
  void Forget() override { localizer_->Forget(); }
  Result<std::unique_ptr<FrameEngine>> Another() const override {
    return Over(localizer_->Another());
  }
  MapFacts facts() const override;
  TileMemory memory() const override { return localizer_->memory(); }

 private:
  std::unique_ptr<Localizer> localizer_;
};

MapFacts LocalizerEngine::facts() const {
  const MapBundle& map = localizer_->map();
  MapFacts facts;
  facts.bundle = localizer_->bundle();
  if (map.release()) facts.created_s = map.release()->statement.created_s;
  for (const BundlePart& part : map.manifest().parts) {
    if (part.path.starts_with("tiles/")) ++facts.num_tiles;
  }
  for (std::uint32_t p = 0; p < map.panoramas().size(); ++p) {
    facts.panoramas.push_back(map.panoramas()[p].position);
    for (const std::uint32_t link : map.panoramas()[p].links) {
      if (p < link) facts.links.emplace_back(p, link);
    }
  }
  return facts;
}

class LocalizerSource : public EngineSource {
 public:
  LocalizerSource(const std::filesystem::path& bundle, const LocalizerOptions& options)
      : bundle_(bundle), options_(options) {}
  Result<Camera> BundleCamera() override { return Localizer::ReadBundleCamera(bundle_); }
  Result<std::unique_ptr<FrameEngine>> Open(const Camera& camera) override {
    return LocalizerEngine::Over(Localizer::Open(bundle_, camera, options_));
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
