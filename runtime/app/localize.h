#pragma once
// The on-line engine over recorded frames, in order.

#include <filesystem>
#include <optional>
#include <string>

#include "runtime/localizer/localizer.h"

namespace panofix {

struct LocalizeOptions {
  std::filesystem::path bundle, drive, out;
  std::string format = "csv";                // csv, tum, geojson or gpx
  std::optional<std::filesystem::path> log;  // run log as JSON: latency by stage, comparisons
  LocalizerOptions localizer;
};

// One row a frame; a frame that cannot be read or decoded is a no_fix row with its reason. The file
// is written at the end, atomically; on Ctrl-C it holds the frames done so far and kCancelled is
// returned.
[[nodiscard]] Status LocalizeDrive(const LocalizeOptions& options);

}  // namespace panofix
