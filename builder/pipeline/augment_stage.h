#pragma once
// The stage that renders views between the panoramas and extracts their features.

#include <filesystem>
#include <vector>

#include "builder/extract/station_features.h"
#include "builder/pipeline/extract_stage.h"

namespace panofix {

struct AugmentStageResult {
  // Of each panorama asked for: its stations, the panorama itself first, and the key of the file
  // with the features of the others (empty where there are none).
  std::vector<std::vector<Station>> stations;
  std::vector<std::string> keys;
  std::vector<PartDigests> parts;   // what decided the keys
  std::vector<std::uint32_t> made;  // of those asked for, the ones whose file was not there
  std::uint64_t num_bytes_written = 0;
};

// Stations of the panoramas `own` (indices), among `panoramas` that hold all within two links of
// them. TBB over `own`. A panorama's stations depend on it and on panoramas near it only, so that a
// change elsewhere leaves their file as it is. Ctrl-C throws Error(kCancelled).
[[nodiscard]] AugmentStageResult AugmentStage(const std::vector<ExtractedPanorama>& panoramas,
                                              const std::vector<std::uint32_t>& own,
                                              const Rectifier& rectifier,
                                              const StationOptions& stations,
                                              const StationExtractOptions& options,
                                              const WorkFolder& work, Progress* progress);

}  // namespace panofix
