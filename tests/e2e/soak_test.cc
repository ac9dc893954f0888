// Long runs of the real service at twice the rate that it can keep up with. Only where
// PANOFIX_SOAK_S says for how many seconds: 1500 makes some 30 000 frames at 20 a second.
#include <gtest/gtest.h>
#include <httplib.h>
#include <signal.h>

#include <cstdlib>
#include <thread>

#include "tests/e2e/data_set.h"

namespace panofix::e2e {
namespace {

constexpr int kHttpPort = 18080, kWarmUp_s = 10;
constexpr double kDeadline_ms = 300, kMemoryTolerance = 0.02;

// The metric's value, or -1.
double Metric(const std::string& name) {
  const auto response = httplib::Client("127.0.0.1", kHttpPort).Get("/metrics");
  if (!response) return -1;
  const std::string text = "\n" + response->body;
  const auto at = text.find("\n" + name + " ");
  return at == std::string::npos ? -1 : std::stod(text.substr(at + name.size() + 2));
}

TEST(Soak, MemoryStaysFlatAndAReplayAgrees) {
  const char* seconds = std::getenv("PANOFIX_SOAK_S");
  if (seconds == nullptr) GTEST_SKIP() << "set PANOFIX_SOAK_S";
  const int duration_s = std::atoi(seconds);
  const TownData data(EasyTown());
  const auto bundle = data.root() / "map", recording = data.root() / "run.mcap";
  ASSERT_EQ(data.Build(data.panoramas(), bundle).exit_code, 0);
  const std::string frames = "ipc://" + (data.root() / "frames").string();
  Process serve(RuntimeCommand({"serve", "--bundle", bundle.string(), "--frames", frames, "--poses",
                                "ipc://" + (data.root() / "poses").string(), "--http",
                                std::to_string(kHttpPort), "--deadline-ms",
                                std::to_string(kDeadline_ms), "--record", recording.string()}));
  Process play(RuntimeCommand({"play", "--drive", data.drive().string(), "--bind", frames, "--rate",
                               "20", "--loop", "--now"}));
  std::this_thread::sleep_for(std::chrono::seconds(std::max(kWarmUp_s, duration_s / 10)));
  const double memory_before = Metric("process_resident_memory_bytes");
  const double cpu_before = Metric("process_cpu_seconds_total");
  const double answers_before = Metric("panofix_latency_seconds_count{stage=\"total\"}");
  std::this_thread::sleep_for(std::chrono::seconds(duration_s));
  const double memory = Metric("process_resident_memory_bytes");
  const double answers = Metric("panofix_latency_seconds_count{stage=\"total\"}");
  EXPECT_GT(answers - answers_before, duration_s);
  EXPECT_NEAR(memory / memory_before, 1, kMemoryTolerance) << memory_before << " to " << memory;
  // 99 % within the deadline and one step of work.
  const double in_time = Metric("panofix_latency_seconds_bucket{stage=\"total\",le=\"0.5\"}");
  EXPECT_GT(in_time / answers, 0.99);
  std::printf("%.0f frames, %.0f answers, %.0f replaced, memory %.1f to %.1f MB, %.2f cores\n",
              Metric("panofix_frames_received_total"), answers,
              Metric("panofix_frames_dropped_total{cause=\"replaced\"}"), memory_before / 1e6,
              memory / 1e6, (Metric("process_cpu_seconds_total") - cpu_before) / duration_s);
  play.Signal(SIGINT);
  serve.Signal(SIGTERM);
  EXPECT_EQ(serve.Wait(5), 0) << serve.Errors();
  Process replay(RuntimeCommand({"replay", recording.string(), "--bundle", bundle.string()}));
  EXPECT_EQ(replay.Wait(60 + 4.0 * duration_s), 0) << replay.Errors();
}

}  // namespace
}  // namespace panofix::e2e
