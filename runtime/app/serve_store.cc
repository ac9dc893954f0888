#include "runtime/app/serve_store.h"

#include <optional>
#include <stdexcept>

#include "common/base/log.h"
#include "runtime/app/health_probe.h"
#include "runtime/service/frame_engine.h"
#include "runtime/store/acceptance.h"
#include "runtime/store/upkeep.h"

namespace panofix {
namespace {

constexpr double kProbe_s = 300;

// Keeps a version from being removed for as long as an engine of its map lives.
class HeldEngine : public FrameEngine {
 public:
  HeldEngine(std::shared_ptr<const VersionHold> hold, std::unique_ptr<FrameEngine> engine)
      : hold_(std::move(hold)), engine_(std::move(engine)) {}
  FrameResult Localize(std::int64_t timestamp_ns, const GrayImage& frame,
                       const TimeIsUp& time_is_up) override {
    return engine_->Localize(timestamp_ns, frame, time_is_up);
  }
  FrameResult Undecodable(std::int64_t timestamp_ns) const override {
    return engine_->Undecodable(timestamp_ns);
  }
  const BundleIdentity& bundle() const override { return engine_->bundle(); }
  const Camera& camera() const override { return engine_->camera(); }
  void Forget() override { engine_->Forget(); }
  Result<std::unique_ptr<FrameEngine>> Another() const override {
    auto another = engine_->Another();
    if (!another.ok()) return another;
    return std::unique_ptr<FrameEngine>(std::make_unique<HeldEngine>(hold_, std::move(*another)));
  }
  MapFacts facts() const override { return engine_->facts(); }
  TileMemory memory() const override { return engine_->memory(); }

 private:
  const std::shared_ptr<const VersionHold> hold_;
  const std::unique_ptr<FrameEngine> engine_;
};

// The first of a store's versions that opens; then that one, until another is activated.
class StoreSource : public EngineSource {
 public:
  StoreSource(const StoreLayout& layout, std::vector<std::string> versions,
              const LocalizerOptions& options)
      : layout_(layout), versions_(std::move(versions)), options_(options) {}

  Result<Camera> BundleCamera() override {
    return Localizer::ReadBundleCamera(layout_.version(versions_[at_]));
  }

  Result<std::unique_ptr<FrameEngine>> Open(const Camera& camera) override {
    while (true) {
      auto engine = OpenVersion(versions_[at_], camera);
      const bool is_last = at_ + 1 == versions_.size();
      const bool is_told_to_stop = engine.status().code() == ErrorCode::kCancelled;
      if (engine.ok() || is_chosen_ || is_last || is_told_to_stop) {
        is_chosen_ = is_chosen_ || engine.ok();
        return engine;
      }
      Log(LogLevel::kError, Format("version %.12s does not open: ", versions_[at_].c_str()) +
                                engine.status().message() +
                                Format("; taking version %.12s instead. Mend the store with "
                                       "panofix-runtime fsck --repair",
                                       versions_[at_ + 1].c_str()));
      ++at_;
    }
  }

  // What `activate` and `rollback` put in force is served once it is proven; so is the version in
  // force at the start, where another stands in for it, once it opens.
  std::string NewerMap() override {
    const auto state = ReadStoreState(layout_);
    if (!state.ok() || !state->is_proven || !IsSha256(state->active)) return {};
    newer_ = state->active == versions_[at_] ? "" : state->active;
    return newer_;
  }

  Result<std::unique_ptr<FrameEngine>> OpenUpdate(const Camera& camera) override {
    const auto map_camera = Localizer::ReadBundleCamera(layout_.version(newer_));
    if (!map_camera.ok()) return map_camera.status();
    if (map_camera->width_px != camera.width_px || map_camera->height_px != camera.height_px) {
      return Status(ErrorCode::kWrongCamera,
                    Format("version %.12s is for a camera of %dx%d pixels, the feed's has %dx%d",
                           newer_.c_str(), map_camera->width_px, map_camera->height_px,
                           camera.width_px, camera.height_px));
    }
    auto engine = OpenVersion(newer_, camera);
    if (engine.ok()) versions_ = {newer_}, at_ = 0, is_chosen_ = true;
    return engine;
  }

 private:
  Result<std::unique_ptr<FrameEngine>> OpenVersion(const std::string& id, const Camera& camera) {
    // Keys may have come or gone since the last version.
    const auto keys = ReadStoreKeys(layout_);
    if (!keys.ok()) return keys.status();
    options_.trusted_keys = keys->ring;
    auto hold = VersionHold::Take(layout_, id);
    if (!hold.ok()) return hold.status();
    auto engine = MakeLocalizerSource(layout_.version(id), options_)->Open(camera);
    if (!engine.ok()) return engine.status();
    return std::unique_ptr<FrameEngine>(std::make_unique<HeldEngine>(
        std::make_shared<const VersionHold>(std::move(*hold)), std::move(*engine)));
  }

  const StoreLayout layout_;
  std::vector<std::string> versions_;
  LocalizerOptions options_;
  std::size_t at_ = 0;
  bool is_chosen_ = false;
  std::string newer_;  // told last
};

void WarnIfExpired(const StoreLayout& layout, const std::string& id) {
  const auto bundle = ReadVersion(layout, id);
  const auto state = ReadStoreState(layout);
  if (!bundle.ok()) return;
  const Status fresh = CheckExpiry(*bundle->release, state.ok() ? *state : StoreState{});
  if (!fresh.ok()) LogWarning(fresh.message() + "; it is served all the same");
}

}  // namespace

Status ServeStore(const std::filesystem::path& store, ServeOptions options) {
  const StoreLayout layout{store};
  const auto keys = ReadStoreKeys(layout);
  if (!keys.ok()) return keys.status();
  const Status settled = SettleActivation(layout, MakeHealthProbe(layout, kProbe_s));
  if (settled.code() == ErrorCode::kCancelled) return settled;
  if (!settled.ok()) Log(LogLevel::kError, settled.message());
  const auto versions = RunnableVersions(layout);
  if (!versions.ok()) return versions.status();
  WarnIfExpired(layout, versions->front());
  options.bundle = layout.version(versions->front());
  options.localizer.trusted_keys = keys->ring;
  try {
    options.localizer.Check();
  } catch (const std::invalid_argument& error) {
    return {ErrorCode::kInvalidArgument, error.what()};
  }
  StoreSource source(layout, *versions, options.localizer);
  return ServeFrom(options, source);
}

}  // namespace panofix
