#pragma once
// What a bundle is, for people and for machines.

#include <filesystem>
#include <string>

#include "builder/validate/signature_state.h"
#include "common/map/map_bundle.h"

namespace panofix {

// Length of the road that the links draw, metres; each link counts once. Where no panorama has
// links, the shortest tree that joins neighbours within 80 m.
[[nodiscard]] double RouteLength_m(const MapBundle& bundle);

// Size of all files of the bundle but its signature, bytes.
[[nodiscard]] std::uint64_t BundleBytes(const MapBundle& bundle);

[[nodiscard]] std::string InspectText(const MapBundle& bundle, const SignatureState& signature);
[[nodiscard]] std::string InspectJson(const MapBundle& bundle, const SignatureState& signature);

// The signature alone: what may be said of a bundle that is not opened for its sake.
[[nodiscard]] std::string SignatureText(const SignatureState& signature);
[[nodiscard]] std::string SignatureJson(const SignatureState& signature);

}  // namespace panofix
