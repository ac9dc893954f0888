#pragma once
// A zstd patch applied to an object that is here, as `zstd --patch-from` makes it.

#include <cstdint>
#include <functional>
#include <span>
#include <string>

#include "common/base/status.h"
#include "runtime/store/object_pool.h"

namespace panofix {

// Gives the next bytes of the patch; 0 at its end.
using ReadPatch = std::function<Result<std::size_t>(std::span<std::uint8_t>)>;

// Decodes onto `writer`, which holds the size limit; `target_bytes` is what it will take. The base
// object is read from the pool. kIncomplete where the base is missing or the patch is cut short,
// kBadData where it is none. Memory: the base mapped, and a window of PatchWindowLog.
[[nodiscard]] Status ApplyPatch(const StoreLayout& layout, const std::string& base_sha256,
                                std::uint64_t target_bytes, const ReadPatch& read,
                                ObjectWriter* writer);

}  // namespace panofix
