#pragma once
// How often a stage took how long.

#include <array>
#include <cstddef>
#include <cstdint>

namespace panofix {

class LatencyHistogram {
 public:
  // Upper ends of the buckets; what is slower counts in the total only.
  static constexpr std::array<double, 13> kUpper_ms{2,   5,   10,  20,  35,   50,  75,
                                                    100, 150, 250, 500, 1000, 2500};

  void Add(double duration_ms) {
    for (std::size_t i = 0; i < kUpper_ms.size(); ++i) {
      if (duration_ms <= kUpper_ms[i]) {
        ++counts_[i];
        break;
      }
    }
    ++num_;
    sum_ms_ += duration_ms;
  }
  // Durations up to and including kUpper_ms[bucket].
  [[nodiscard]] std::int64_t NumUpTo(std::size_t bucket) const {
    std::int64_t num = 0;
    for (std::size_t i = 0; i <= bucket; ++i) num += counts_[i];
    return num;
  }
  [[nodiscard]] std::int64_t num() const { return num_; }
  [[nodiscard]] double sum_ms() const { return sum_ms_; }

 private:
  std::array<std::int64_t, kUpper_ms.size()> counts_{};
  std::int64_t num_ = 0;
  double sum_ms_ = 0;
};

}  // namespace panofix
