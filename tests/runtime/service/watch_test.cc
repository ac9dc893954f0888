// What those who watch a running service see, and deadlines, over real sockets.
#include <gtest/gtest.h>
#include <httplib.h>

#include "tests/runtime/service/service_support.h"

namespace panofix {
namespace {

using namespace service_test;

class Watching : public ServiceTest {
 protected:
  ServeOptions Options(const std::string& frames) {
    ServeOptions options = ServeOptionsFor(frames);
    options.http_port = 0;
    options.max_rate_hz = 200;
    options.on_http = [this](int port) { port_ = port; };
    return options;
  }
  [[nodiscard]] httplib::Response Get(const char* path) const {
    const auto result = httplib::Client("127.0.0.1", port_).Get(path);
    return result ? *result : httplib::Response{};
  }
  // The metric's value, or -1.
  [[nodiscard]] double Metric(const std::string& name) const {
    const std::string text = "\n" + Get("/metrics").body;
    const auto at = text.find("\n" + name + " ");
    return at == std::string::npos ? -1 : std::stod(text.substr(at + name.size() + 2));
  }

  FakeSource source_;
  std::atomic<int> port_{0};
};

TEST_F(Watching, EveryFrameIsAccountedFor) {
  Publisher camera = OpenPublisher();
  source_.work_ms = 20;
  RunningServe serve(Options(camera.endpoint()), source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  EXPECT_EQ(Get("/healthz").status, 200);
  EXPECT_EQ(Get("/readyz").status, 503);
  const auto jpeg = PackFrame(7, SampleJpeg());
  ASSERT_TRUE(
      SendUntil(camera, kFrameTopic, jpeg, poses, [](const ReceivedResult&) { return true; }));
  EXPECT_EQ(Get("/readyz").status, 200);
  for (int i = 0; i < 60; ++i) {
    ASSERT_TRUE(camera.Send(kFrameTopic, jpeg).ok());
    SleepMs(4);
    if (i % 10 != 0) continue;
    ASSERT_TRUE(camera.Send(kFrameTopic, std::vector<std::uint8_t>(9)).ok());
  }
  EXPECT_TRUE(Eventually([&] {
    const double received = Metric("panofix_frames_received_total");
    return received > 60 &&
           received == Metric("panofix_frames_dropped_total{cause=\"replaced\"}") +
                           Metric("panofix_frames_dropped_total{cause=\"refused\"}") +
                           Metric("panofix_frames_dropped_total{cause=\"rate_limited\"}") +
                           Metric("panofix_answers_total{status=\"fix\",reason=\"\"}");
  })) << Get("/metrics").body;
  EXPECT_GT(Metric("panofix_frames_dropped_total{cause=\"replaced\"}"), 10);
  EXPECT_EQ(Metric("panofix_map_tiles"), 3);
  EXPECT_EQ(Get("/api/frame").body.substr(0, 2), "\xff\xd8");
}

TEST_F(Watching, TimeThatIsUpIsAnsweredAsSuch) {
  Publisher camera = OpenPublisher();
  ServeOptions options = Options(camera.endpoint());
  options.deadline_ms = 60;
  source_.work_ms = 5000;
  RunningServe serve(options, source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  const auto frame = PackFrame(7, SampleJpeg());
  const auto late =
      SendUntil(camera, kFrameTopic, frame, poses, [](const ReceivedResult&) { return true; });
  ASSERT_TRUE(late.has_value());
  EXPECT_EQ(late->row.status, FixStatus::kNoFix);
  EXPECT_EQ(late->row.reason, "deadline");
  EXPECT_GT(Metric("panofix_answers_total{status=\"no_fix\",reason=\"deadline\"}"), 0);
  // The next frame that has time enough is answered as ever.
  source_.work_ms = 0;
  EXPECT_TRUE(SendUntil(camera, kFrameTopic, PackFrame(8, SampleJpeg()), poses,
                        [](const ReceivedResult& r) { return r.row.status == FixStatus::kFix; }));
}

// Grey and small enough, whatever the camera sends.
TEST_F(Watching, RawFramesHaveAPictureToo) {
  Publisher camera = OpenPublisher();
  RunningServe serve(Options(camera.endpoint()), source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  const auto show = [&](std::int64_t time_ns, const GrayImage& frame) {
    EXPECT_TRUE(SendUntil(
        camera, kFrameTopic, PackRawFrame(time_ns, frame), poses,
        [&](const ReceivedResult& result) { return result.row.timestamp_ns == time_ns; }));
    const auto response = Get("/api/frame");
    EXPECT_EQ(response.status, 200);
    EXPECT_EQ(response.get_header_value("Content-Type"), "image/jpeg");
    EXPECT_EQ(response.get_header_value("X-Timestamp-Ns"), std::to_string(time_ns));
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(response.body.data());
    return ValueOrThrow(DecodeGray({bytes, response.body.size()}));
  };
  GrayImage ramp{64, 48, {}};
  for (int i = 0; i < 64 * 48; ++i) ramp.pixels.push_back(static_cast<std::uint8_t>(2 * (i % 64)));
  const GrayImage shown = show(9, ramp);
  ASSERT_EQ(shown.width_px, 64);
  ASSERT_EQ(shown.height_px, 48);
  constexpr int kTolerance = 6;  // what JPEG loses of a ramp
  for (std::size_t i = 0; i < shown.pixels.size(); ++i)
    ASSERT_NEAR(shown.pixels[i], ramp.pixels[i], kTolerance) << i;
  // Within the limit of a frame, larger than a page needs.
  const GrayImage wide = show(10, SampleImage(1600, 400));
  EXPECT_EQ(wide.width_px, 1280);
  EXPECT_EQ(wide.height_px, 320);
}

TEST_F(Watching, StopsWhileSomebodyWatches) {
  RunningServe serve(Options("tcp://127.0.0.1:9"), source_);
  httplib::Client client("127.0.0.1", port_);
  client.set_keep_alive(true);
  ASSERT_TRUE(client.Get("/healthz"));
  EXPECT_TRUE(serve.Stop().ok());
  EXPECT_FALSE(client.Get("/healthz"));
}

TEST_F(Watching, ADeadlineThatLeavesNoTimeIsToldOnce) {
  Publisher camera = OpenPublisher();
  ServeOptions options = ServeOptionsFor(camera.endpoint());
  options.deadline_ms = 1;
  source_.work_ms = 1000;
  RunningServe serve(options, source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  SetLogLevel("warning");
  testing::internal::CaptureStderr();
  int num_late = 0;
  EXPECT_TRUE(SendUntil(
      camera, kFrameTopic, PackFrame(1, SampleJpeg()), poses,
      [&](const ReceivedResult& r) { return r.row.reason == "deadline" && ++num_late == 45; }));
  const std::string log = testing::internal::GetCapturedStderr();
  SetLogLevel("off");
  const auto at = log.find("--deadline-ms 1 ended");
  ASSERT_NE(at, std::string::npos) << log;
  EXPECT_EQ(log.find("--deadline-ms 1 ended", at + 1), std::string::npos) << log;
}

}  // namespace
}  // namespace panofix
