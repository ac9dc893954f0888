#pragma once
// The stage that turns panoramas into feature files, reusing those whose inputs have not changed.

#include <filesystem>
#include <string>
#include <vector>

#include "builder/extract/panorama_features.h"
#include "builder/pipeline/key_parts.h"
#include "builder/pipeline/work_folder.h"
#include "common/base/progress.h"

namespace panofix {

struct ExtractedPanorama {
  PanoramaRecord record;
  std::string content_key;              // SHA-256 of inputs, options and code version
  PartDigests parts;                    // what it was made from
  std::filesystem::path features_file;  // named by the key
  bool has_depth = false;
};

struct ExtractStageResult {
  std::vector<ExtractedPanorama> panoramas;  // in the order given
  std::vector<SetAside> set_aside, without_depth;
  std::vector<std::uint32_t> made;  // of the panoramas, those whose file was not there
  std::uint64_t num_bytes_written = 0;
};

// Throws Error(kCancelled) after Ctrl-C; what stages have written is there for the next run.
void StopIfCancelled();

// What decides a panorama's features: program, camera and views, options, and the bytes of its
// files.
[[nodiscard]] KeyParts ContentKey(const PanoramaRecord& record, const Rectifier& rectifier,
                                  const ExtractOptions& options);

// TBB over panoramas; one at a time a thread in memory. Ctrl-C throws Error(kCancelled) after the
// panoramas under way are written.
[[nodiscard]] ExtractStageResult ExtractStage(const std::vector<PanoramaRecord>& records,
                                              const Rectifier& rectifier,
                                              const ExtractOptions& options, const WorkFolder& work,
                                              Progress* progress);

}  // namespace panofix
