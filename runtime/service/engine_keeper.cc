#include "runtime/service/engine_keeper.h"

#include <algorithm>
#include <cmath>

#include "common/base/log.h"
#include "runtime/service/loading_engine.h"
#include "runtime/service/messages.h"
#include "runtime/service/topics.h"

namespace panofix {
namespace {

using Clock = std::chrono::steady_clock;

bool SameCamera(const Camera& a, const Camera& b) {
  return a.width_px == b.width_px && a.height_px == b.height_px && a.fx_px == b.fx_px &&
         a.fy_px == b.fy_px && a.cx_px == b.cx_px && a.cy_px == b.cy_px &&
         a.distortion == b.distortion &&
         (a.distortion_model == b.distortion_model || !a.HasDistortion());
}

// Small maps are open by then, and nobody needs to be told.
constexpr std::chrono::milliseconds kOpeningPatience(250);

std::string Size(const Camera& camera) {
  return Format("%dx%d", camera.width_px, camera.height_px);
}

std::string Describe(const BundleIdentity& bundle) {
  return Format("bundle %s, build %lld, id %.12s%s", bundle.name.c_str(),
                static_cast<long long>(bundle.build), bundle.id.c_str(),
                bundle.is_signed ? "" : ", UNSIGNED");
}

}  // namespace

// A map that is still being opened uses the source; a future of std::async waits by itself.
EngineKeeper::~EngineKeeper() {
  if (update_.valid()) update_.wait();
  if (opening_.valid()) opening_.wait();
}

void EngineKeeper::Retire(std::unique_ptr<FrameEngine> engine) {
  // Giving a future up waits for it, so that is done there too.
  retired_ = std::async(std::launch::async,
                        [engine = std::move(engine), before = std::move(retired_)]() mutable {
                          engine.reset();
                          before = {};
                        });
}

void EngineKeeper::Use(std::unique_ptr<FrameEngine> engine) {
  if (engine_) Retire(std::move(engine_));
  engine_ = std::move(engine);
  MakeSpare();
  refused_.reset();  // another map may take it
  ++generation_;
  monitor_.SetMap(engine_->facts());
}

void EngineKeeper::MakeSpare() {
  if (options_.requests.empty()) return;
  auto spare = engine_->Another();
  if (!spare.ok()) {
    Log(LogLevel::kError, "requests stay with the map before: " + spare.status().message());
    return;
  }
  std::unique_lock lock(spare_mutex_);
  std::swap(spare_, *spare);
  lock.unlock();
  if (*spare) Retire(std::move(*spare));
}

std::unique_ptr<FrameEngine> EngineKeeper::TakeSpare() {
  const std::lock_guard lock(spare_mutex_);
  return std::move(spare_);
}

Status EngineKeeper::Open() {
  auto bundle_camera = source_.BundleCamera();
  if (!bundle_camera.ok()) return bundle_camera.status();
  bundle_camera_ = *bundle_camera;
  spare_ = std::make_unique<LoadingEngine>(bundle_camera_);
  Camera camera = bundle_camera_;
  if (options_.camera) {
    auto given = ReadCameraYaml(*options_.camera);
    if (!given.ok()) return given.status();
    camera = *given;
    camera_is_known_ = true;
  }
  return StartOpening(camera);
}

Status EngineKeeper::StartOpening(const Camera& camera) {
  opening_camera_ = camera;
  opening_ = std::async(std::launch::async, [this, camera] { return source_.Open(camera); });
  if (opening_.wait_for(kOpeningPatience) == std::future_status::ready) return TakeOpened();
  before_ = std::move(engine_);
  engine_ = std::make_unique<LoadingEngine>(camera);
  MakeSpare();
  LogInfo("the map is being opened; until then frames are answered \"map_loading\"");
  return {};
}

Status EngineKeeper::TakeOpened() {
  Opened opened = opening_.get();
  if (opened.ok()) {
    if (before_) Retire(std::move(before_));
    Use(std::move(*opened));
    LogInfo(Describe(engine_->bundle()));
    return {};
  }
  if (before_) {
    engine_ = std::move(before_);
    MakeSpare();
  }
  if (generation_ == 0) return opened.status();
  refused_ = opening_camera_;
  confirmed_.reset();  // it was the other's
  LogWarning("calibration refused: " + opened.status().message() +
             "; it is not tried again with this map");
  return {};
}

void EngineKeeper::TakeCalibration(const WireBytes& payload) {
  const auto camera = UnpackCalibration(payload);
  if (!camera.ok()) {
    calibration_log_.Warn("calibration refused: " + camera.status().message());
    return;
  }
  const auto now = Clock::now();
  if (SameCamera(*camera, engine_->camera())) {
    confirmed_ = now;
    camera_is_known_ = true;
    return;
  }
  if (options_.camera) {
    calibration_log_.Warn("calibration of the feed differs from " + options_.camera->string() +
                          "; the file is used");
    return;
  }
  if (camera->width_px != bundle_camera_.width_px ||
      camera->height_px != bundle_camera_.height_px) {
    calibration_log_.Warn("calibration refused: " + Size(*camera) +
                          " pixels, but the bundle is for " + Size(bundle_camera_) +
                          "; build a bundle for this camera");
    return;
  }
  // The map would be opened again and again, for each in turn.
  if (confirmed_ &&
      now - *confirmed_ < std::chrono::duration<double>(options_.calibration_hold_s)) {
    monitor_.Count(&MonitorSnapshot::num_rival_calibrations);
    rival_log_.Warn(
        options_.frames +
        ": a calibration that differs from the one in use, which comes as well: two "
        "cameras publish on one feed. The one in use stays, but frames of the other get "
        "wrong poses; give each camera a feed and a runtime of its own");
    return;
  }
  // It is sent every second, and each try costs frames their answer.
  if (refused_ && SameCamera(*camera, *refused_)) return;
  // A map under way would come for the old camera; the next calibration, a second later, is taken.
  if (update_.valid() || opening_.valid()) return;
  LogInfo("calibration of the feed: opening the map for it");
  confirmed_ = now;
  static_cast<void>(StartOpening(*camera));
  camera_is_known_ = opening_.valid() || SameCamera(*camera, engine_->camera());
}

bool EngineKeeper::CameraIsKnown(double waited_s) {
  if (camera_is_known_ || waited_s < options_.camera_wait_s) return camera_is_known_;
  LogWarning(
      Format("%s: no usable calibration on %s within %.1f s of the first frame; using the "
             "bundle's camera. Publish one, or give --camera",
             options_.frames.c_str(), std::string(kCameraTopic).c_str(), options_.camera_wait_s));
  camera_is_known_ = true;
  return true;
}

Status EngineKeeper::TakeUpdate() {
  if (!opening_.valid()) {
    TakeNewer();
    return {};
  }
  const bool is_open = opening_.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
  return is_open ? TakeOpened() : Status();
}

void EngineKeeper::StartUpdate() {
  const auto now = Clock::now();
  if (now - asked_ < std::chrono::duration<double>(options_.update_interval_s)) return;
  asked_ = now;
  const std::string newer = source_.NewerMap();
  if (newer != newer_) num_tries_ = 0;
  newer_ = newer;
  if (newer.empty() || (num_tries_ > 0 && now < retry_at_)) return;
  LogInfo("a newer map is active; opening it beside the one in use");
  update_ = std::async(std::launch::async,
                       [this, camera = engine_->camera()] { return source_.OpenUpdate(camera); });
}

void EngineKeeper::PutOff(const Status& status) {
  monitor_.Count(&MonitorSnapshot::num_failed_swaps);
  const double wait_s = std::min(options_.max_retry_wait_s,
                                 std::ldexp(options_.retry_wait_s, std::min(num_tries_, 30)));
  ++num_tries_;
  retry_at_ = Clock::now() +
              std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(wait_s));
  Log(LogLevel::kError, "the newer map does not open: " + status.message() + "; going on with " +
                            Describe(engine_->bundle()) +
                            Format(", it is tried again in %g s", wait_s));
}

void EngineKeeper::TakeNewer() {
  if (!update_.valid()) return StartUpdate();
  if (update_.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return;
  Opened opened = update_.get();
  if (!opened.ok()) return PutOff(opened.status());
  Use(std::move(*opened));
  monitor_.Count(&MonitorSnapshot::num_swaps);
  LogInfo("now " + Describe(engine_->bundle()));
}

}  // namespace panofix
