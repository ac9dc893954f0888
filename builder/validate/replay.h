#pragma once
// Runs the runtime over a recorded drive, as it ships: its program, not its sources.

#include <filesystem>
#include <string>
#include <vector>

#include "common/drive/poses_csv.h"
#include "common/drive/run_log.h"

namespace panofix {

struct Replay {
  std::vector<PoseRow> poses;
  RunLog log;
};

// panofix-runtime beside the running program, or the first in PATH.
[[nodiscard]] Result<std::filesystem::path> FindRuntime();

// `RUNTIME localize --bundle … --drive …` with its outputs in a temporary folder that is removed.
// Throws Error: the runtime's exit code becomes ours, its own line on stderr says why.
[[nodiscard]] Replay ReplayDrive(const std::filesystem::path& runtime,
                                 const std::filesystem::path& bundle,
                                 const std::filesystem::path& drive,
                                 const std::vector<std::string>& extra);

}  // namespace panofix
