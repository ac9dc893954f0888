#pragma once
// What this process has taken of the machine's memory.

#include <cstdint>

namespace panofix {

// Largest resident set so far, bytes.
[[nodiscard]] std::uint64_t PeakMemoryBytes();

}  // namespace panofix
