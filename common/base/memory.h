#pragma once
// What this process has taken of the machine's memory.

#include <cstdint>

namespace panofix {

// Largest resident set so far, bytes.
[[nodiscard]] std::uint64_t PeakMemoryBytes();
// Resident set now, bytes; 0 where the system does not tell.
[[nodiscard]] std::uint64_t ResidentMemoryBytes();

// Of these, what is not shared memory: 0 where the system does not tell.
[[nodiscard]] std::uint64_t PrivateMemoryBytes();

// Gives the system back what the allocator keeps of freed memory. Costs milliseconds.
void ReturnFreedMemory();

}  // namespace panofix
