#pragma once
// What is remembered of the last frames, by their times. Those come from outside and may be
// anything, so they are compared before they are subtracted, and never subtracted as integers.

#include <cstdint>
#include <vector>

namespace panofix {

// Nanoseconds in, seconds out.
[[nodiscard]] inline double SecondsBetween(std::int64_t from_ns, std::int64_t to_ns) {
  return 1e-9 * static_cast<double>(to_ns) - 1e-9 * static_cast<double>(from_ns);
}

// Drops what is too old for a frame at `now_ns`, and all where time does not go forward. `timed`
// have a timestamp_ns, older first.
template <typename Timed>
void ForgetOld(std::int64_t now_ns, double max_age_s, std::vector<Timed>* timed) {
  if (!timed->empty() && now_ns <= timed->back().timestamp_ns) timed->clear();
  std::erase_if(*timed, [&](const Timed& one) {
    return SecondsBetween(one.timestamp_ns, now_ns) > max_age_s;
  });
}

}  // namespace panofix
