// What a frame costs, stage by stage, beside the extraction of its features alone, in one run.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <opencv2/features2d.hpp>

#include "common/base/log.h"
#include "common/map/map_bundle.h"
#include "tests/bench/drive_bench.h"

namespace panofix {
namespace {

struct Options : DriveBenchOptions {
  int num_rounds = 3;  // over the drive; the first warms up and is left out
};

struct FrameCost {
  double detect_and_compute_ms = 0;
  StageLatency latency;
};

// OpenCV's own cost on the frame that the runtime extracts from.
double DetectAndCompute_ms(const GrayImage& frame, const FeatureOptions& options) {
  GrayImage image = Preprocess(frame, options);
  const cv::Mat mat(image.height_px, image.width_px, CV_8UC1, image.pixels.data());
  const auto start = std::chrono::steady_clock::now();
  std::vector<cv::KeyPoint> keypoints;
  cv::Mat descriptors;
  cv::SIFT::create(options.max_sift, 3, options.sift_contrast_threshold)
      ->detectAndCompute(mat, cv::noArray(), keypoints, descriptors);
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
      .count();
}

double Quantile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1) + 0.5)];
}

void PrintTable(const char* name, const std::vector<FrameCost>& costs) {
  std::printf("\n%s: %zu frames\n%-18s %9s %9s %12s\n", name, costs.size(), "stage", "p50 ms",
              "p99 ms", "of extraction");
  std::vector<double> alone;
  for (const FrameCost& cost : costs) alone.push_back(cost.detect_and_compute_ms);
  const auto row = [&](const char* stage, const auto& value_of) {
    std::vector<double> values;
    for (const FrameCost& cost : costs) values.push_back(value_of(cost));
    const double p50 = Quantile(values, 0.5);
    std::printf("%-18s %9.1f %9.1f %12.2f\n", stage, p50, Quantile(values, 0.99),
                p50 / std::max(1e-9, Quantile(alone, 0.5)));
  };
  row("detectAndCompute", [](const FrameCost& c) { return c.detect_and_compute_ms; });
  row("preprocess", [](const FrameCost& c) { return c.latency.preprocess_ms; });
  row("features", [](const FrameCost& c) { return c.latency.features_ms; });
  row("retrieval", [](const FrameCost& c) { return c.latency.retrieval_ms; });
  row("matching", [](const FrameCost& c) { return c.latency.matching_ms; });
  row("pose", [](const FrameCost& c) { return c.latency.pose_ms; });
  row("total", [](const FrameCost& c) { return c.latency.total_ms; });
}

void Measure(const Options& options) {
  const Drive drive = ValueOrThrow(ReadDrive(options.drive));
  std::string id;
  const FeatureOptions features =
      ValueOrThrow(MapBundle::ReadManifest(options.bundle, &id)).features;
  std::vector<FrameCost> tracked, lost;
  for (int round = 0; round < options.num_rounds; ++round) {
    // Anew each time: the first frames of a drive are lost ones.
    const auto localizer =
        ValueOrThrow(Localizer::Open(options.bundle, drive.camera, options.localizer));
    for (const DriveFrame& frame : drive.frames) {
      const GrayImage image = ReadFrame(frame);
      const double alone_ms = DetectAndCompute_ms(image, features);
      const FrameResult result = localizer->Localize(frame.timestamp_ns, image);
      if (round == 0 && options.num_rounds > 1) continue;
      // A frame that was looked up in the map was not followed.
      (result.num_compared == 0 ? tracked : lost).push_back({alone_ms, result.latency});
    }
  }
  PrintTable("tracked", tracked);
  PrintTable("looked up", lost);
}

}  // namespace
}  // namespace panofix

int main(int argc, char** argv) {
  CLI::App app("frame_latency: cost of tracked and of looked-up frames beside SIFT alone");
  panofix::Options options;
  panofix::AddTo(&app, "folder with frames.csv and camera.yaml", &options);
  app.add_option("--rounds", options.num_rounds, "times over the drive; the first warms up")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  return panofix::RunBench(&app, argc, argv, [&] { panofix::Measure(options); });
}
