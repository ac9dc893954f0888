#pragma once
// Publishes a map bundle: parts into a staging folder, manifest last, one rename.

#include <filesystem>
#include <vector>

#include "common/map/manifest.h"

namespace panofix {

// A part that is written already, and what it must be.
struct FinishedPart {
  BundlePart part;
  std::filesystem::path file;
};

// Writes the bundle next to `target` and publishes it by one rename: each part is copied and
// compared with its hash on the way. `manifest` comes with its counts and with the parts' list. On
// failure or Ctrl-C the staging folder is removed and an existing bundle stays. Returns the
// manifest as written. Throws Error.
Manifest PublishParts(const std::filesystem::path& target, const Manifest& manifest,
                      const std::vector<FinishedPart>& parts);

}  // namespace panofix
