#pragma once
// Writes a map bundle: parts into a staging folder, manifest last, one rename to publish.

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "builder/publish/bundle_parts.h"

namespace panofix {

// Makes the tile of panoramas [begin, end), one tile in memory at a time; may refine the panoramas'
// poses.
using MakeTile =
    std::function<BundleTile(std::size_t begin, std::size_t end, std::vector<MapPanorama>*)>;

// Writes the bundle next to `target` and publishes it by one rename; on failure or Ctrl-C the
// staging folder is removed and an existing bundle stays. Returns the manifest as written. Throws
// Error.
Manifest WriteBundle(const std::filesystem::path& target, BundleContent content,
                     const MakeTile& make_tile);

// A part that is written already, and what it must be.
struct FinishedPart {
  BundlePart part;
  std::filesystem::path file;
};

// The same from finished parts: each is copied and compared with its hash on the way. `manifest`
// comes with its counts and with the parts' list.
Manifest PublishParts(const std::filesystem::path& target, const Manifest& manifest,
                      const std::vector<FinishedPart>& parts);

}  // namespace panofix
