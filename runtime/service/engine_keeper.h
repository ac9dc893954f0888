#pragma once
// The engine in use, and when it becomes another one: a calibration from the feed, a new map.

#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "runtime/service/frame_engine.h"
#include "runtime/service/log_throttle.h"
#include "runtime/service/serve.h"
#include "runtime/service/wire_bytes.h"

namespace panofix {

// Used by the service's thread alone but for TakeSpare; what it refers to outlives it.
class EngineKeeper {
 public:
  EngineKeeper(const ServeOptions& options, EngineSource& source, ServiceMonitor& monitor)
      : options_(options), source_(source), monitor_(monitor) {}
  ~EngineKeeper();

  // Opens the map before the first calibration can arrive, so that a bad one is told at once. One
  // that takes long is opened on in a thread of its own; frames are answered "map_loading" then.
  [[nodiscard]] Status Open();
  [[nodiscard]] bool is_loading() const { return opening_.valid(); }
  [[nodiscard]] FrameEngine& engine() { return *engine_; }
  // Goes up by one whenever the engine is another one.
  [[nodiscard]] int generation() const { return generation_; }

  // Takes what the feed says of its camera: another engine where it differs and fits the bundle. Of
  // two cameras that disagree the one in use stays.
  void TakeCalibration(const WireBytes& payload);
  // Whether frames may be answered: they are left unanswered for a while before the calibration,
  // because a wrong camera gives wrong poses. `waited_s`: since the first frame.
  [[nodiscard]] bool CameraIsKnown(double waited_s);
  // For single images: one more engine over the map in use, or one that answers "map_loading" until
  // there is one; null where it was taken before. Thread-safe once Open has returned.
  [[nodiscard]] std::unique_ptr<FrameEngine> TakeSpare();

  // Asks for a newer map now and then, opens it beside the one in use and takes it once it is
  // ready. Never waits. One that does not open is tried again, less and less often. An error where
  // the first map does not open.
  [[nodiscard]] Status TakeUpdate();

 private:
  using Opened = Result<std::unique_ptr<FrameEngine>>;
  void Use(std::unique_ptr<FrameEngine> engine);
  void MakeSpare();
  // Ends an engine beside the loop: the memory of a large map takes longer to free than a frame may
  // wait.
  void Retire(std::unique_ptr<FrameEngine> engine);
  // Opens the map for another camera; see Open. Frames wait although an engine is in use: what it
  // would answer with a camera that the feed no longer has would be wrong.
  [[nodiscard]] Status StartOpening(const Camera& camera);
  [[nodiscard]] Status TakeOpened();
  void TakeNewer();
  void StartUpdate();
  // The newer map did not open.
  void PutOff(const Status& status);

  const ServeOptions& options_;
  EngineSource& source_;
  ServiceMonitor& monitor_;
  std::unique_ptr<FrameEngine> engine_;
  Camera bundle_camera_;
  bool camera_is_known_ = false;
  int generation_ = 0;
  std::mutex spare_mutex_;  // guards spare_
  std::unique_ptr<FrameEngine> spare_;
  // When the feed last said that its camera is the one in use.
  std::optional<std::chrono::steady_clock::time_point> confirmed_;
  Camera opening_camera_;                // that the map is, or was last, opened for
  std::optional<Camera> refused_;        // that the map in use does not open for
  std::future<Opened> opening_;          // valid while the map is being opened for a camera
  std::unique_ptr<FrameEngine> before_;  // in use before that; absent at the start
  std::future<Opened> update_;           // valid while a newer map is being opened
  std::chrono::steady_clock::time_point asked_;
  std::future<void> retired_;  // valid while, or after, engines are ended
  std::string newer_;          // the map that was opened last as an update, or tried
  int num_tries_ = 0;          // that failed, of this map
  std::chrono::steady_clock::time_point retry_at_;
  LogThrottle calibration_log_, rival_log_;
};

}  // namespace panofix
