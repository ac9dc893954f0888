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

// The first of a store's versions that opens; from then on that one.
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
      auto engine = OpenPresent(camera);
      const bool is_last = at_ + 1 == versions_.size();
      if (engine.ok() || is_chosen_ || is_last) {
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

 private:
  Result<std::unique_ptr<FrameEngine>> OpenPresent(const Camera& camera) {
    auto hold = VersionHold::Take(layout_, versions_[at_]);
    if (!hold.ok()) return hold.status();
    auto engine = MakeLocalizerSource(layout_.version(versions_[at_]), options_)->Open(camera);
    if (engine.ok()) hold_ = std::move(*hold);
    return engine;
  }

  const StoreLayout layout_;
  const std::vector<std::string> versions_;
  const LocalizerOptions options_;
  std::size_t at_ = 0;
  bool is_chosen_ = false;
  std::optional<VersionHold> hold_;  // for as long as it is served
};

void WarnIfExpired(const StoreLayout& layout, const std::string& id) {
  const auto bundle = ReadVersion(layout, id);
  const auto state = ReadStoreState(layout);
  if (!bundle.ok()) return;
  const Status fresh =
      CheckExpiry(*bundle->release, TrustedNow_s(state.ok() ? *state : StoreState{}));
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
