#pragma once
// Which poses a user may act on. Thresholds are in PoseOptions; they were fitted on generated
// towns.

#include <string>

#include "common/map/map_bundle.h"
#include "runtime/pose/frame_matches.h"
#include "runtime/pose/pose_options.h"
#include "runtime/pose/station_grid.h"

namespace panofix {

// The reason of what another place explains nearly as well.
inline constexpr const char* kAmbiguousPlace = "ambiguous_place";

// Whether a pose is so well supported that its ratio to chance need not be high.
[[nodiscard]] bool HasPlenty(const PoseOutcome& outcome, const PoseOptions& options);

// Whether a tracked pose is so sure that the frame at full size would tell nothing new.
[[nodiscard]] bool IsSure(const PoseOutcome& outcome, const PoseOptions& options);

// The first gate that a candidate fails, as a reason word, or "".
[[nodiscard]] std::string FailedGate(const PoseOutcome& outcome, const MapBundle& bundle,
                                     const LocalFrame& local, const PoseOptions& options);

// Where the camera would be against the map's panoramas and a vehicle's attitude, as a reason word,
// or "".
[[nodiscard]] std::string ImplausiblePlace(const Rigid3& local_from_cam, const MapBundle& bundle,
                                           const LocalFrame& local, const PoseOptions& options);

// sqrt(sigma_x^2 + sigma_y^2) of the position in the map.
[[nodiscard]] double PositionSigma_m(const PoseOutcome& outcome);

// Marks a trusted pose as degraded, with its reason and wider sigmas, where it is only good for
// that.
void DegradeDoubtful(const PoseOptions& options, PoseOutcome* outcome);
// Of these the doubts that need no landmarks of the map: beyond it, or of large sigma.
void DegradeFarOrVague(const PoseOptions& options, PoseOutcome* outcome);

// From the nearest station, horizontally; 100 m where none is nearer.
[[nodiscard]] double StationDistance_m(const StationGrid& stations, const LocalFrame& local,
                                       const Rigid3& cam_from_local);

// For fitting gates: a debug line with all that the gates look at.
void LogCandidate(const PoseOutcome& outcome, const MapBundle& bundle, const LocalFrame& local);

}  // namespace panofix
