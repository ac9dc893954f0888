#pragma once
// A service's run as an MCAP file: what went in, what came out, and what a replay must know.
// schemas/messages.md tells what it holds.

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>

#include "runtime/localizer/localizer.h"
#include "runtime/monitor/service_monitor.h"

namespace panofix {

struct IncomingFrame;

struct RecorderLimits {
  // Frames that wait for the disk; what comes beyond is left out of the recording and counted.
  std::size_t max_waiting_bytes = std::size_t{64} << 20;
  // At the end for what waits, and once more for the end marks and the flush to the disk.
  double finish_patience_s = 0.4;
  std::function<void()> before_write;  // for tests: a slow disk
};

// Writes in a thread of its own, so that no answer waits for the disk. Used by one thread.
class SessionRecorder {
 public:
  // `path`: a file that is not there yet, or a folder, where the file is named after the time.
  [[nodiscard]] static Result<std::unique_ptr<SessionRecorder>> Create(
      const std::filesystem::path& path, const LocalizerOptions& options, ServiceMonitor& monitor,
      RecorderLimits limits = {});
  ~SessionRecorder();
  SessionRecorder(const SessionRecorder&) = delete;
  SessionRecorder& operator=(const SessionRecorder&) = delete;

  // The engine from here on: its map and camera.
  void AddEngine(const BundleIdentity& bundle, const Camera& camera);
  // A frame and its answer (a packed LocalizationResult). `stopped_at_step`: the question of
  // TimeIsUp that ended the work, counting from 1; 0 = none. A disk that fails ends the recording,
  // with an error in the log, and nothing else; one that is too slow leaves a gap, after which a
  // replay no longer compares.
  void AddAnswer(const IncomingFrame& frame, std::span<const std::uint8_t> answer,
                 int stopped_at_step);
  // Ends the file; the destructor does too. Does not wait long: a disk that does not answer keeps
  // the writing thread, which is left behind then, and the file may be as after a crash.
  void Finish();
  [[nodiscard]] const std::string& path() const;

 private:
  struct Impl;
  explicit SessionRecorder(std::shared_ptr<Impl> impl);
  std::shared_ptr<Impl> impl_;  // shared with the writing thread
};

}  // namespace panofix
