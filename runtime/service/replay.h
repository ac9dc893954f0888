#pragma once
// A recorded run of the service, once more.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "runtime/service/frame_engine.h"

namespace panofix {

// Opens the map of this id for a camera, with the recorded run's options (num_threads is free).
using ReplayOpener = std::function<Result<std::unique_ptr<FrameEngine>>(
    const std::string& map_id, const Camera& camera, const LocalizerOptions& options)>;
// The bundle among these folders whose id it is; kNotFound names the id.
[[nodiscard]] ReplayOpener OpenerOver(std::vector<std::filesystem::path> bundles,
                                      const KeyRing& trusted_keys);

struct ReplayReport {
  std::int64_t num_frames = 0, num_fixes = 0;
  std::int64_t num_different = 0;  // answers that are not those of the recording, latencies apart
  std::int64_t first_different_ns = 0;  // the first such frame's time
  std::int64_t num_not_compared = 0;    // they come after frames that the recording lacks
  bool was_cut = false;                 // the recording lacks its end, as after a crash
  std::vector<PoseRow> rows;
};

// Answers each recorded frame anew, ended at the recorded step where its time was up then, and
// compares all but latencies bit for bit. Errors: the file, a map that is not there, Ctrl-C.
[[nodiscard]] Result<ReplayReport> Replay(const std::filesystem::path& recording,
                                          const ReplayOpener& open);

}  // namespace panofix
