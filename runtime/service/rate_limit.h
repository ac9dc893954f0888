#pragma once
// How many messages a second are taken from outside.

#include <algorithm>
#include <chrono>

namespace panofix {

// A budget that fills at the allowed rate, so that a hiccup's messages pass together. Used by one
// thread.
class RateLimit {
 public:
  explicit RateLimit(double max_rate_hz) : max_rate_hz_(max_rate_hz) {}  // 0 = no bound

  bool MayPass() {
    constexpr double kBurst_s = 0.25;
    if (!(max_rate_hz_ > 0)) return true;
    const auto now = std::chrono::steady_clock::now();
    const double since_s = std::chrono::duration<double>(now - filled_).count();
    filled_ = now;
    budget_ = std::min(std::max(1.0, kBurst_s * max_rate_hz_), budget_ + since_s * max_rate_hz_);
    if (budget_ < 1) return false;
    budget_ -= 1;
    return true;
  }

 private:
  const double max_rate_hz_;
  std::chrono::steady_clock::time_point filled_;  // long ago: the budget begins full
  double budget_ = 0;
};

}  // namespace panofix
