#pragma once
// At most one log line of a kind every few seconds, however often a peer provokes it.

#include <chrono>
#include <cstdint>
#include <string>

#include "common/base/log.h"

namespace panofix {

class LogThrottle {
 public:
  explicit LogThrottle(std::chrono::milliseconds interval = std::chrono::seconds(5))
      : interval_(interval) {}

  bool Warn(const std::string& message) { return Write(LogLevel::kWarning, message); }
  // Logs a line, or counts it for the next one that is let through; whether it was logged.
  bool Write(LogLevel level, const std::string& message) {
    const auto now = std::chrono::steady_clock::now();
    if (shown_once_ && now - shown_ < interval_) {
      ++held_back_;
      return false;
    }
    Log(level, held_back_ == 0
                   ? message
                   : message + " (and " + std::to_string(held_back_) + " more like it)");
    shown_once_ = true, shown_ = now, held_back_ = 0;
    return true;
  }

 private:
  std::chrono::milliseconds interval_;
  std::chrono::steady_clock::time_point shown_;
  bool shown_once_ = false;
  std::int64_t held_back_ = 0;
};

}  // namespace panofix
