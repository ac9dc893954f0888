#pragma once
// Checks that the readers of a bundle's parts share.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>
#include <string>

#include "common/base/status.h"
#include "common/io/hdf5_file.h"

namespace panofix::map_internal {

inline constexpr const char* kMend = "; fetch the bundle again or build it again";

inline Status Bad(const std::string& what) { return {ErrorCode::kBadData, what + kMend}; }

template <typename T>
bool AllFinite(std::span<const T> values) {
  return std::all_of(values.begin(), values.end(), [](T v) { return std::isfinite(v); });
}

// offsets[0] = 0, ascending, last = size: then every slice lies inside its array.
inline bool AreOffsets(std::span<const std::uint32_t> offsets, std::size_t rows, std::size_t size) {
  return offsets.size() == rows + 1 && offsets.front() == 0 && offsets.back() == size &&
         std::is_sorted(offsets.begin(), offsets.end());
}

inline bool AllBelow(std::span<const std::uint32_t> values, std::size_t bound) {
  return std::all_of(values.begin(), values.end(), [&](std::uint32_t v) { return v < bound; });
}

}  // namespace panofix::map_internal

// Reads array `name` into `target`, or returns the failure from the calling function.
#define PANOFIX_READ(target, file, type, name, cols)      \
  auto target##_read = (file).Read<type>(name, cols);     \
  if (!target##_read.ok()) return target##_read.status(); \
  auto target = std::move(target##_read).value()
