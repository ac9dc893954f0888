#pragma once
// Bytes that are made once somebody asks for them, and once only.

#include <cstdint>
#include <functional>
#include <mutex>
#include <span>
#include <utility>
#include <vector>

namespace panofix {

class LazyBytes {
 public:
  using Make = std::function<std::vector<std::uint8_t>()>;
  explicit LazyBytes(Make make) : make_(std::move(make)) {}

  // Thread-safe; valid as long as this object.
  [[nodiscard]] std::span<const std::uint8_t> Get() {
    const std::lock_guard lock(mutex_);
    // Let go of what they are made of.
    if (Make make = std::exchange(make_, nullptr)) bytes_ = make();
    return bytes_;
  }

 private:
  std::mutex mutex_;
  Make make_;
  std::vector<std::uint8_t> bytes_;
};

}  // namespace panofix
