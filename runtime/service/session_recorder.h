#pragma once
// A service's run as an MCAP file: what went in, what came out, and what a replay must know.
// schemas/messages.md tells what it holds.

#include <filesystem>
#include <memory>
#include <optional>

#include "runtime/localizer/localizer.h"
#include "runtime/monitor/service_monitor.h"

namespace panofix {

struct IncomingFrame;

class SessionRecorder {
 public:
  // `path`: a file that is not there yet, or a folder, where the file is named after the time.
  [[nodiscard]] static Result<std::unique_ptr<SessionRecorder>> Create(
      const std::filesystem::path& path, const LocalizerOptions& options, ServiceMonitor& monitor);
  ~SessionRecorder();
  SessionRecorder(const SessionRecorder&) = delete;
  SessionRecorder& operator=(const SessionRecorder&) = delete;

  // The engine from here on: its map and camera.
  void AddEngine(const BundleIdentity& bundle, const Camera& camera);
  // A frame and its answer (a packed LocalizationResult). `stopped_at_step`: the question of
  // TimeIsUp that ended the work, counting from 1; 0 = none. A disk that fails ends the recording,
  // with an error in the log, and nothing else.
  void AddAnswer(const IncomingFrame& frame, std::span<const std::uint8_t> answer,
                 int stopped_at_step);
  // Ends the file; without it the file is as after a crash.
  void Finish();
  [[nodiscard]] const std::string& path() const;

 private:
  struct Impl;
  explicit SessionRecorder(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace panofix
