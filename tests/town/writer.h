#pragma once
// Writes the town as the product's inputs (README, "Panorama data set" and "Drive").

#include <filesystem>

#include "tests/town/camera_effects.h"
#include "tests/town/town.h"

namespace panofix::town {

// Everything below throws panofix::Error where the disk fails or the user cancels.

// Refuses a folder that holds anything but an earlier town; removes the parts to be written anew.
void PrepareFolder(const std::filesystem::path& directory, const TownOptions& options);
// panoramas.geojson, panoramas/*.jpg and *.gsv, truth_panoramas.csv.
void WritePanoramas(const Town& town, const std::filesystem::path& directory);
// drive/: frames.csv, camera.yaml, truth.csv, images/.
void WriteDrive(const Town& town, const std::filesystem::path& directory);
// camera.yaml and town.json.
void WriteSummary(const Town& town, const std::filesystem::path& directory);
// All of the above.
void WriteTown(const Town& town, const std::filesystem::path& directory);

// One picture, from the town's poses to bytes.
[[nodiscard]] ByteImage RenderPanorama(const Town& town, std::size_t index);
[[nodiscard]] ByteImage RenderFrame(const Town& town, std::size_t index);

}  // namespace panofix::town
