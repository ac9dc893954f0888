#pragma once
// The on-line client: subscribes to a camera feed, localizes, publishes poses.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "common/base/status.h"
#include "runtime/localizer/localizer.h"
#include "runtime/service/frame_engine.h"
#include "runtime/service/wire_security.h"

namespace panofix {

struct ServeOptions {
  std::filesystem::path bundle;
  std::string frames;  // endpoint of the feed: connected to, or bound where it holds a '*'
  std::string poses;   // endpoint to publish on: bound
  // camera.yaml of the feed. Without it the calibration comes from the feed (kCameraTopic), and
  // where none comes within `camera_wait_s` of the first frame, from the bundle, with a warning.
  std::optional<std::filesystem::path> camera;
  double camera_wait_s = 2;
  // A calibration of the feed is in force until it has not come for so long; one that differs is
  // passed over meanwhile. It is sent every second.
  double calibration_hold_s = 3;
  LocalizerOptions localizer;
  std::size_t max_message_bytes = std::size_t{64} << 20;  // a larger frame ends the connection
  // Frames that come faster are left out, requests (counted apart) refused; 0 = no bound.
  double max_rate_hz = 120;
  WireSecurity frames_security, poses_security;
  // From a frame's arrival, or a request's: work on it ends at the next step and it is answered
  // no_fix, "deadline"; 0 = none.
  double deadline_ms = 0;
  // Port on 127.0.0.1 for /metrics, /healthz, /readyz and the live page; 0 = any; absent = none.
  std::optional<int> http_port;
  std::string requests;  // endpoint for single images on request; empty = none
  // MCAP file to keep the run in, or a folder for it; see SessionRecorder.
  std::optional<std::filesystem::path> record;
  double update_interval_s = 1;  // between looks for a newer map
  // One that does not open is tried again after so long, then after twice that, and so on.
  double retry_wait_s = 10, max_retry_wait_s = 600;
  double quiet_warning_s = 3;     // without a frame for this long a log line says so
  double report_interval_s = 30;  // between log lines with counts
  std::int64_t max_frames = 0;    // stop after so many answers; 0 = when told to
  // Told the bound pose endpoint once frames are awaited: for "tcp://127.0.0.1:*".
  std::function<void(const std::string& poses)> on_ready;
  std::function<void(int port)> on_http;  // told the HTTP port, if there is one
  std::function<void(const std::string& requests)> on_requests;  // and that endpoint
  void Check() const;                                            // throws std::invalid_argument
};

// Answers each frame that it takes with one LocalizationResult, and with one LocationFix where
// there is a pose, under the frame's own timestamp. Frames that arrive while one is being worked on
// replace each other: the newest wins. A frame that cannot be decoded is answered too (no_fix); a
// payload that does not verify has no trustworthy timestamp and is counted and logged only. A
// calibration of another size than the bundle's camera, or one that does not verify, is refused
// with a log line. Returns ok within a second (and the engine's current frame) of
// CancelRequested(). Errors: a bad option, a bundle that does not open, an endpoint that cannot be
// had (named, with the mend).
[[nodiscard]] Status Serve(const ServeOptions& options);
// The same over any engine; `options.bundle` and `options.localizer` are only for messages then.
[[nodiscard]] Status ServeFrom(const ServeOptions& options, EngineSource& source);

}  // namespace panofix
