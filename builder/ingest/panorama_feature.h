#pragma once
// One GeoJSON feature to one panorama record, every rule of the format checked.

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "builder/ingest/panorama_set.h"

namespace panofix {

struct FeatureOutcome {
  PanoramaRecord record;  // its id is set wherever the feature has one, also beside a reason
  std::string reason;     // empty: the record is good. Else fault and mend in one line
};

// `folder` is what the feature's relative paths start from.
[[nodiscard]] FeatureOutcome RecordFromFeature(const nlohmann::json& feature,
                                               const std::filesystem::path& folder);

}  // namespace panofix
