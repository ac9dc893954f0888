#pragma once
// A bundle into a store: everything is asked before a byte is kept, and it is there whole or not at
// all.

#include <cstdint>
#include <string>

#include "runtime/store/bundle_source.h"
#include "runtime/store/store.h"

namespace panofix {

struct InstallOptions {
  // A bundle that states more is refused, signed or not.
  std::uint64_t max_bytes = std::uint64_t{64} << 30;
};

struct InstallReport {
  std::string id;
  std::int64_t build = 0;
  std::size_t num_parts = 0, num_new_parts = 0;
  std::uint64_t num_bytes = 0, num_new_bytes = 0;  // on disk, not on the way
};

// Checks signature, name, camera, format, expiry and build of what `source` offers, fetches the
// parts that are not here, each checked against the signed manifest, and puts the version beside
// the others. The active version is not touched. What an interrupted try left is used again. A
// bundle that is here gets its newer signature. Every refusal has a code of its own
// (common/base/status.h), and leaves the store as it was but for parts that a later try can use.
[[nodiscard]] Result<InstallReport> Install(const StoreLayout& layout, BundleSource& source,
                                            const InstallOptions& options);

}  // namespace panofix
