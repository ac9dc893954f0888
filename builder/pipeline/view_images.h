#pragma once
// Pictures of the panoramas' own views, for estimators that look at more than their landmarks.

#include <cstdint>
#include <span>
#include <vector>

#include "builder/pipeline/extract_stage.h"

namespace panofix {

// Every view of the panoramas as it was described: cut, equalised, as JPEG of quality 95; panorama
// by panorama. Cut anew from the panoramas: costs a decode each, in parallel. Throws Error.
[[nodiscard]] std::vector<std::vector<std::uint8_t>> EncodeViewImages(
    std::span<const ExtractedPanorama> panoramas, const Rectifier& rectifier,
    const FeatureOptions& features);

}  // namespace panofix
