#pragma once
// Descriptors for tests: random bytes, and copies of them with a little noise.

#include <algorithm>
#include <cstdint>
#include <vector>

#include "common/base/rng.h"
#include "common/features/features.h"

namespace panofix {

// N x 128 bytes, each below `bound`.
inline std::vector<std::uint8_t> RandomDescriptors(std::size_t count, Rng* rng, int bound = 256) {
  std::vector<std::uint8_t> bytes(count * kDescriptorSize);
  for (auto& byte : bytes) {
    byte = static_cast<std::uint8_t>(rng->Below(static_cast<std::uint64_t>(bound)));
  }
  return bytes;
}

// The same with every byte moved by at most `amount`.
inline std::vector<std::uint8_t> Disturbed(const std::vector<std::uint8_t>& bytes, int amount,
                                           Rng* rng) {
  std::vector<std::uint8_t> result;
  for (const std::uint8_t byte : bytes) {
    const int shift = static_cast<int>(rng->Below(static_cast<std::uint64_t>(2 * amount + 1)));
    result.push_back(static_cast<std::uint8_t>(std::clamp(byte + shift - amount, 0, 255)));
  }
  return result;
}

}  // namespace panofix
