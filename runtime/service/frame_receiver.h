#pragma once
// The camera feed: a thread that always reads, and a mailbox that holds the newest frame only.

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "runtime/monitor/service_monitor.h"
#include "runtime/service/wire_bytes.h"
#include "runtime/service/wire_security.h"

namespace panofix {

struct FrameReceiverOptions {
  std::string endpoint;  // connected to; bound where it holds a '*'
  std::size_t max_message_bytes = std::size_t{64} << 20;
  double max_rate_hz = 0;  // frames beyond are left out; 0 = no bound
  WireSecurity security;
  double quiet_warning_s = 3;  // without a frame for this long a log line says so
};

struct ArrivedFrame {
  WireBytes payload;
  std::chrono::steady_clock::time_point arrived;
};

// A slow taker always gets the newest frame, a few milliseconds old, instead of a growing backlog.
// Thread-safe. Waits for a publisher without end, and picks up one that died and came back.
class FrameReceiver {
 public:
  [[nodiscard]] static Result<std::unique_ptr<FrameReceiver>> Open(
      const FrameReceiverOptions& options);
  ~FrameReceiver();
  FrameReceiver(const FrameReceiver&) = delete;
  FrameReceiver& operator=(const FrameReceiver&) = delete;

  // The newest payload of kFrameTopic since the last call; waits for one up to `timeout`.
  [[nodiscard]] std::optional<ArrivedFrame> TakeFrame(std::chrono::milliseconds timeout);
  // The newest payloads of kCameraTopic since the last call, in their order: two cameras on one
  // feed must not hide each other.
  [[nodiscard]] std::vector<WireBytes> TakeCalibrations();
  [[nodiscard]] FeedCounts counters() const;
  // Not ok once the socket itself has failed; nothing more will come then.
  [[nodiscard]] Status status() const;
  [[nodiscard]] const std::string& endpoint() const;

 private:
  struct Impl;
  explicit FrameReceiver(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace panofix
