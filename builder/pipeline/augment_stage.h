#pragma once
// The stage that renders views between the panoramas and extracts their features.

#include <filesystem>
#include <vector>

#include "builder/extract/station_features.h"
#include "builder/pipeline/extract_stage.h"

namespace panofix {

struct AugmentStageResult {
  // Of each panorama: its stations, the panorama itself first, and the file with the features of
  // the others (empty where there are none).
  std::vector<std::vector<Station>> stations;
  std::vector<std::filesystem::path> files;
  std::size_t num_stations = 0, num_reused = 0;  // virtual ones; panoramas whose file was there
};

// TBB over panoramas. A panorama's stations depend on it and on panoramas near it only, so that a
// change elsewhere leaves their file as it is. Ctrl-C throws Error(kCancelled).
[[nodiscard]] AugmentStageResult AugmentStage(const std::vector<ExtractedPanorama>& panoramas,
                                              const Rectifier& rectifier,
                                              const StationOptions& stations,
                                              const StationExtractOptions& options,
                                              const std::filesystem::path& work);

}  // namespace panofix
