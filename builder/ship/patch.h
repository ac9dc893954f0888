#pragma once
// What changed between two files, as `zstd --patch-from` would write it.

#include <cstdint>
#include <span>
#include <vector>

namespace panofix {

// Empty where a patch does not pay: it saves less than a fifth of `target`, or the files are too
// large (kMaxPatchedBytes). Equal arguments give equal bytes. Memory: about three times both.
// Throws Error.
std::vector<std::uint8_t> MakePatch(std::span<const std::uint8_t> base,
                                    std::span<const std::uint8_t> target);

}  // namespace panofix
