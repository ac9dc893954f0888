#pragma once
// Bundles of an older format as this release's, where schemas/README.md says that a step allows it.

#include <cstdint>
#include <filesystem>
#include <optional>

#include "common/map/manifest.h"

namespace panofix {

// Writes the bundle in `from` to `out`, a new folder, in the format of this release, by the rules
// of PublishParts. Tiles get the arrays that the format has learnt since, and keep all others;
// other parts stay as they are, to the byte; the manifest says what it has learnt to say. It has
// another id, so it is unsigned; `build` is its number where given, at least the old one. Equal
// arguments give equal bytes. Returns the new manifest. Throws Error: kUnsupportedVersion where no
// step leads from its format to this one, kInvalidArgument where none is needed, and PublishParts'
// where a part is missing or damaged.
Manifest MigrateBundle(const std::filesystem::path& from, const std::filesystem::path& out,
                       std::optional<std::int64_t> build);

}  // namespace panofix
