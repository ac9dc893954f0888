#pragma once
// Options of retrieval and estimators that a set of levers stands for.

#include <cstdint>

#include "common/camera/camera.h"
#include "common/map/map_bundle.h"
#include "runtime/localizer/levers.h"
#include "runtime/pose/paper_estimator.h"
#include "runtime/pose/pose_options.h"
#include "runtime/retrieval/retrieval.h"

namespace panofix {

[[nodiscard]] RetrievalOptions RetrievalOptionsFor(const Levers& levers, const MapBundle& bundle,
                                                   std::uint64_t max_memory_bytes);
[[nodiscard]] PaperOptions PaperOptionsFor(const Levers& levers, const Camera& camera,
                                           std::uint64_t seed);
[[nodiscard]] PoseOptions PoseOptionsFor(const Levers& levers, const MapBundle& bundle,
                                         const Camera& camera, std::uint64_t seed);

}  // namespace panofix
