#pragma once
// The stage that turns panoramas into feature files, reusing those whose inputs have not changed.

#include <filesystem>
#include <string>
#include <vector>

#include "builder/extract/panorama_features.h"

namespace panofix {

struct ExtractedPanorama {
  PanoramaRecord record;
  std::string content_key;              // SHA-256 of inputs, options and code version
  std::filesystem::path features_file;  // named by the key
  bool has_depth = false;
};

struct ExtractStageResult {
  std::vector<ExtractedPanorama> panoramas;  // in the order given
  std::vector<SetAside> set_aside, without_depth;
  std::size_t num_reused = 0;
};

// Throws Error(kCancelled) after Ctrl-C; what stages have written is there for the next run.
void StopIfCancelled();

// SHA-256 over the panorama's record and the bytes of its files, the view directions, camera and
// options: equal keys, equal features.
[[nodiscard]] Result<std::string> ContentKey(const PanoramaRecord& record,
                                             const Rectifier& rectifier,
                                             const ExtractOptions& options);

// TBB over panoramas; one at a time a thread in memory. Ctrl-C throws Error(kCancelled) after the
// panoramas under way are written.
[[nodiscard]] ExtractStageResult ExtractStage(const std::vector<PanoramaRecord>& records,
                                              const Rectifier& rectifier,
                                              const ExtractOptions& options,
                                              const std::filesystem::path& work);

}  // namespace panofix
