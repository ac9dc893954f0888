#pragma once
// A lock that is had in the order in which it was asked for.

#include <condition_variable>
#include <cstdint>
#include <mutex>

namespace panofix {

// For std::unique_lock. Who unlocks and locks again lets all who wait go first; std::mutex lets a
// busy thread keep it for ever.
class FairMutex {
 public:
  void lock() {
    std::unique_lock lock(mutex_);
    const std::uint64_t ticket = next_++;
    changed_.wait(lock, [&] { return serving_ == ticket; });
  }
  void unlock() {
    {
      const std::lock_guard lock(mutex_);
      ++serving_;
    }
    changed_.notify_all();
  }

 private:
  std::mutex mutex_;  // guards what follows
  std::condition_variable changed_;
  std::uint64_t next_ = 0, serving_ = 0;
};

}  // namespace panofix
