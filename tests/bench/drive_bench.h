#pragma once
// What the measurements of a map and a drive share: their options, frames, and the end of a run.

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <filesystem>

#include "common/drive/drive.h"
#include "common/image/gray_image.h"
#include "common/io/read_file.h"
#include "runtime/localizer/localizer.h"

namespace panofix {

struct DriveBenchOptions {
  std::filesystem::path bundle, drive;
  LocalizerOptions localizer;
};

// --bundle, --drive and --threads.
inline void AddTo(CLI::App* app, const char* what_a_drive_is, DriveBenchOptions* options) {
  app->add_option("--bundle", options->bundle, "the map bundle's folder")->required();
  app->add_option("--drive", options->drive, what_a_drive_is)->required();
  app->add_option("--threads", options->localizer.num_threads, "processors to use; 0 = all");
}

// Throws where a frame cannot be read.
[[nodiscard]] inline GrayImage ReadFrame(const DriveFrame& frame) {
  constexpr std::size_t kMaxBytes = std::size_t{64} << 20;
  return ValueOrThrow(DecodeGray(ValueOrThrow(ReadFileBytes(frame.image, kMaxBytes))));
}

// Parses, measures, and says what went wrong; the exit code.
template <typename Measure>
int RunBench(CLI::App* app, int argc, char** argv, const Measure& measure) {
  CLI11_PARSE(*app, argc, argv);
  try {
    measure();
    return 0;
  } catch (const std::exception& error) {
    const std::string name = std::filesystem::path(argv[0]).filename().string();
    std::fprintf(stderr, "%s: %s\n", name.c_str(), error.what());
    return 1;
  }
}

}  // namespace panofix
