#pragma once
// Publishes a recorded drive as a camera would.

#include <filesystem>
#include <functional>
#include <string>

#include "common/base/status.h"
#include "runtime/service/wire_security.h"

namespace panofix {

struct PlayOptions {
  std::filesystem::path drive;
  std::string bind;                  // endpoint to publish on
  double rate_hz = 10;               // frames a second; the recorded gaps are not kept
  bool loop = false;                 // again and again; times of later rounds go on from the last
  bool wait_for_subscriber = false;  // before the first frame, so that none is lost
  double subscriber_timeout_s = 0;   // give up waiting after so long; 0 = never
  bool restamp_now = false;          // capture time = time of sending instead of the recorded one
  WireSecurity security;
  int linger_ms = 2000;  // time given to the last frames to leave
  // Told the bound endpoint before anything is sent: for "tcp://127.0.0.1:*".
  std::function<void(const std::string& endpoint)> on_ready;
  void Check() const;  // throws std::invalid_argument
};

// Sends the drive's image files as they are (CompressedImage), and its calibration at the start,
// every second, and to each new subscriber. Ctrl-C ends it with ok. A late frame is not caught up
// with a burst. Errors: a bad option, a drive that does not read, a frame that is neither JPEG nor
// PNG or has a time before 1970, an endpoint that cannot be had, no subscriber in time (kNotFound).
[[nodiscard]] Status Play(const PlayOptions& options);

}  // namespace panofix
