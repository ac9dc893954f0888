#pragma once
// Recorded drives: frames.csv, camera.yaml and truth.csv of INTERFACES (README, "Drive").

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "common/camera/camera.h"
#include "common/geo/map_frame.h"
#include "common/geometry/attitude.h"

namespace panofix {

struct DriveFrame {
  std::int64_t timestamp_ns = 0;
  std::filesystem::path image;  // absolute or relative to the working directory: ready to open
};

struct TruthPose {
  std::int64_t timestamp_ns = 0;
  Geodetic position;
  std::optional<Attitude> attitude;  // of the camera's body; absent where the columns are blank
};

struct Drive {
  std::vector<DriveFrame> frames;  // in file order
  Camera camera;
  std::vector<TruthPose> truth;  // empty where there is no truth.csv
};

// Reads DIR/frames.csv, DIR/camera.yaml and, if there, DIR/truth.csv. Column order is free, names
// are not; unknown columns are ignored. Failures name the file, the line and the mend.
[[nodiscard]] Result<Drive> ReadDrive(const std::filesystem::path& directory);

}  // namespace panofix
