// A long run of the real service at twice the rate that it can keep up with. Only where
// PANOFIX_SOAK_FRAMES says how many frames are sent: 30000 take some quarter of an hour.
#include <gtest/gtest.h>
#include <httplib.h>
#include <signal.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <thread>

#include "tests/e2e/data_set.h"

namespace panofix::e2e {
namespace {

constexpr int kHttpPort = 18080;
constexpr double kWarmUp_s = 10, kRate_s = 15;  // before the rate is measured, and for that
constexpr double kDeadline_s = 0.3, kMemoryTolerance = 0.02;
constexpr double kSample_s = 2;
// A frame is at work and one waits; counts are read one after the other.
constexpr double kMostUnderWay = 4;

// Small pictures, so that many frames fit into a quarter of an hour.
std::vector<std::string> SmallFrames() {
  std::vector<std::string> options = EasyTown();
  for (std::size_t i = 0; i + 1 < options.size(); ++i) {
    if (options[i] == "--frames") options[i + 1] = "24";
    if (options[i] == "--frame-width-px") options[i + 1] = "320";
    if (options[i] == "--frame-height-px") options[i + 1] = "240";
  }
  return options;
}

// What /metrics says at a moment.
class Metrics {
 public:
  Metrics() {
    const auto response = httplib::Client("127.0.0.1", kHttpPort).Get("/metrics");
    if (response) text_ = "\n" + response->body;
  }
  // -1 where there is none of that name.
  [[nodiscard]] double operator[](const std::string& name) const {
    const auto at = text_.find("\n" + name + " ");
    return at == std::string::npos ? -1 : std::stod(text_.substr(at + name.size() + 2));
  }
  [[nodiscard]] double Answers() const {
    return (*this)["panofix_latency_seconds_count{stage=\"total\"}"];
  }
  [[nodiscard]] double Replaced() const {
    return (*this)["panofix_frames_dropped_total{cause=\"replaced\"}"];
  }
  // Upper edge of the bucket that holds this share of a stage's times, seconds.
  [[nodiscard]] double Quantile(const std::string& stage, double share) const {
    const std::string label = "panofix_latency_seconds_bucket{stage=\"" + stage + "\",le=\"";
    for (auto at = text_.find(label); at != std::string::npos; at = text_.find(label, at + 1)) {
      const std::string line = text_.substr(at + label.size(), 60);
      const double count = std::stod(line.substr(line.find("} ") + 2));
      if (count >= share * Answers()) return std::stod(line);  // "+Inf" too
    }
    return std::numeric_limits<double>::infinity();
  }

 private:
  std::string text_;
};

// Of the samples' tenth that begins at `share` of them: a single one catches a frame at work.
double MedianOfTenth(const std::vector<double>& samples, double share) {
  const auto begin =
      samples.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(samples.size()));
  std::vector<double> tenth(begin, begin + static_cast<std::ptrdiff_t>(samples.size() / 10));
  std::sort(tenth.begin(), tenth.end());
  return tenth[tenth.size() / 2];
}

void Sleep(double duration_s) {
  std::this_thread::sleep_for(std::chrono::duration<double>(duration_s));
}

class Soak : public testing::Test {
 protected:
  [[nodiscard]] std::vector<std::string> Play(double rate_hz) const {
    return RuntimeCommand({"play", "--drive", data_.drive().string(), "--bind", frames_, "--rate",
                           std::to_string(rate_hz), "--loop", "--now"});
  }
  [[nodiscard]] std::vector<std::string> Serve(const std::vector<std::string>& more) const {
    std::vector<std::string> arguments{"serve",
                                       "--bundle",
                                       bundle_.string(),
                                       "--frames",
                                       frames_,
                                       "--poses",
                                       poses_,
                                       "--http",
                                       std::to_string(kHttpPort),
                                       "--deadline-ms",
                                       std::to_string(1e3 * kDeadline_s)};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return RuntimeCommand(arguments);
  }
  // Answers a second where frames are never short.
  [[nodiscard]] double SustainableRate_hz() const {
    Process serve(Serve({}));
    Process play(Play(60));
    Sleep(kWarmUp_s);
    const double before = Metrics().Answers();
    Sleep(kRate_s);
    return (Metrics().Answers() - before) / kRate_s;
  }

  const TownData data_{SmallFrames()};
  const std::filesystem::path bundle_ = data_.root() / "map", recording_ = data_.root() / "r.mcap";
  const std::string frames_ = "ipc://" + (data_.root() / "f").string(),
                    poses_ = "ipc://" + (data_.root() / "p").string();
};

TEST_F(Soak, AtTwiceTheRateNothingGrowsAndAReplayAgrees) {
  const char* wanted = std::getenv("PANOFIX_SOAK_FRAMES");
  if (wanted == nullptr) GTEST_SKIP() << "set PANOFIX_SOAK_FRAMES";
  ASSERT_EQ(data_.Build(data_.panoramas(), bundle_).exit_code, 0);
  const double rate_hz = SustainableRate_hz();
  ASSERT_GT(rate_hz, 0);
  const double duration_s = std::atof(wanted) / (2 * rate_hz);
  Process serve(Serve({"--record", recording_.string()}));
  Process play(Play(2 * rate_hz));
  Sleep(kWarmUp_s + 0.2 * duration_s);  // the live page's trail fills up
  const Metrics first;
  double most_under_way = 0;
  std::vector<double> memory;
  for (double t = 0; t < duration_s; t += kSample_s) {
    Sleep(kSample_s);
    const Metrics now;
    most_under_way = std::max(
        most_under_way, now["panofix_frames_received_total"] - now.Replaced() - now.Answers());
    memory.push_back(now["process_resident_memory_bytes"]);
  }
  const Metrics last;
  const double answers = last.Answers() - first.Answers();
  ASSERT_GE(memory.size(), 10U);
  const double memory_at_first = MedianOfTenth(memory, 0),
               memory_at_last = MedianOfTenth(memory, 0.9);
  double slowest_stage_s = 0;
  for (const char* stage : {"preprocess", "features", "retrieval", "matching", "pose"})
    slowest_stage_s = std::max(slowest_stage_s, last.Quantile(stage, 0.999));
  std::printf(
      "%.0f frames at %.1f a second, twice the sustainable rate: %.0f answers, %.0f "
      "replaced, p99 %.3f s, slowest stage %.3f s, memory %.1f to %.1f MB, at most %.0f "
      "under way, %.2f cores\n",
      last["panofix_frames_received_total"], 2 * rate_hz, last.Answers(), last.Replaced(),
      last.Quantile("total", 0.99), slowest_stage_s, memory_at_first / 1e6, memory_at_last / 1e6,
      most_under_way,
      (last["process_cpu_seconds_total"] - first["process_cpu_seconds_total"]) / duration_s);
  EXPECT_GT(answers, 0.5 * rate_hz * duration_s);
  EXPECT_GT(last.Replaced(), 0.2 * rate_hz * duration_s);
  EXPECT_NEAR(memory_at_last / memory_at_first, 1, kMemoryTolerance);
  EXPECT_LE(last.Quantile("total", 0.99), kDeadline_s + slowest_stage_s);
  EXPECT_LE(most_under_way, kMostUnderWay);
  EXPECT_EQ(last["panofix_not_recorded_messages_total"], 0);
  play.Signal(SIGINT);
  serve.Signal(SIGTERM);
  EXPECT_EQ(serve.Wait(5), 0) << serve.Errors();
  Process replay(RuntimeCommand({"replay", recording_.string(), "--bundle", bundle_.string()}));
  EXPECT_EQ(replay.Wait(60 + 4 * duration_s), 0) << replay.Errors();
}

}  // namespace
}  // namespace panofix::e2e
