#pragma once
// Progress of long work: a live line with rate and time left on a terminal, plain lines elsewhere.

#include <atomic>
#include <chrono>
#include <cstdint>
#include <mutex>
#include <string>

namespace panofix {

// Thread-safe; writes to standard error. Off a terminal it prints a line at most every ten seconds
// and one at the end, so that logs stay readable.
class Progress {
 public:
  Progress(std::string label, std::int64_t total, std::string unit);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  void Add(std::int64_t count = 1);
  void Finish();
  // "extract 12/40 panoramas, 3.1/s, 9 s left": what a line shows after `elapsed_s`.
  [[nodiscard]] static std::string Line(const std::string& label, std::int64_t done,
                                        std::int64_t total, const std::string& unit,
                                        double elapsed_s);

 private:
  void Show(bool last);
  std::string label_, unit_;
  std::int64_t total_;
  std::atomic<std::int64_t> done_{0};
  std::chrono::steady_clock::time_point start_, shown_;
  std::mutex mutex_;
  bool terminal_, finished_ = false;
};

}  // namespace panofix
