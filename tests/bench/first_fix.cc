// How soon a localizer that knows nothing has a fix, and whether it is right, from frames all along
// a drive.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <map>
#include <optional>

#include "common/map/map_bundle.h"
#include "tests/bench/drive_bench.h"

namespace panofix {
namespace {

constexpr double kFalse_m = 5;  // as in the score of a drive

struct Options : DriveBenchOptions {
  std::size_t step_frames = 8, most_frames = 25;
};

struct Start {
  std::size_t num_before = 0;     // frames without a fix before the first one, or all
  std::optional<double> error_m;  // of the first fix; none: there was none
};

Start FirstFix(const Drive& drive, std::size_t first, const Options& options,
               Localizer* localizer) {
  localizer->Forget();
  Start start;
  const std::size_t end = std::min(drive.frames.size(), first + options.most_frames);
  for (std::size_t f = first; f < end; ++f, ++start.num_before) {
    const DriveFrame& frame = drive.frames[f];
    const FrameResult result = localizer->Localize(frame.timestamp_ns, ReadFrame(frame));
    if (result.status != FixStatus::kFix) continue;
    const MapFrame& map = localizer->map().frame();
    start.error_m = (map.ToMap(result.pose->position) - map.ToMap(drive.truth[f].position)).norm();
    break;
  }
  return start;
}

void Measure(const Options& options) {
  const Drive drive = ValueOrThrow(ReadDrive(options.drive));
  if (drive.truth.size() != drive.frames.size())
    throw std::runtime_error(options.drive.string() + ": has no truth.csv for all its frames");
  const auto localizer =
      ValueOrThrow(Localizer::Open(options.bundle, drive.camera, options.localizer));
  int num_starts = 0, num_none = 0, num_false = 0;
  std::map<std::size_t, int> counts;
  for (std::size_t f = 0; f < drive.frames.size(); f += options.step_frames, ++num_starts) {
    const Start start = FirstFix(drive, f, options, localizer.get());
    if (!start.error_m) {
      ++num_none;
      continue;
    }
    ++counts[start.num_before];
    if (!(*start.error_m <= kFalse_m)) {
      ++num_false;
      std::printf("false fix: start at frame %zu, %zu frames later, %.1f m off\n", f,
                  start.num_before, *start.error_m);
    }
  }
  std::printf(
      "starts                    %d\nno fix in %-3zu frames      %d\nfalse first fixes         "
      "%d\n",
      num_starts, options.most_frames, num_none, num_false);
  for (const auto& [num_before, count] : counts)
    std::printf("fix after %-3zu without      %d\n", num_before, count);
}

}  // namespace
}  // namespace panofix

int main(int argc, char** argv) {
  CLI::App app("first_fix: frames until the first fix, started anew all along a drive with truth");
  panofix::Options options;
  panofix::AddTo(&app, "folder with frames.csv, camera.yaml and truth.csv", &options);
  app.add_option("--step", options.step_frames, "frames from start to start")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  app.add_option("--most", options.most_frames, "frames after which a start is given up")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  return panofix::RunBench(&app, argc, argv, [&] { panofix::Measure(options); });
}
