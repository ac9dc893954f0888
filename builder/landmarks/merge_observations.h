#pragma once
// First stage of the landmark layer. Private to the module.

#include "builder/landmarks/layer_types.h"

namespace panofix {

// Groups the observations of one panorama's texture that show one surface point alike: leader
// clustering in an order given by the observations' contents. Observations with a number that is
// not finite, or no distance, are dropped. Linear in time and memory; panoramas in parallel.
[[nodiscard]] MergedLandmarks MergeObservations(const LayerInput& input,
                                                std::span<const LandmarkObservation> observations);

// The descriptor of a cluster of look-alikes: the mean, stretched to the mean length of its parts.
[[nodiscard]] std::array<std::uint8_t, kDescriptorSize> MeanDescriptor(
    std::span<const std::uint8_t* const> descriptors);

}  // namespace panofix
