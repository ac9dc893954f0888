// The service over real sockets, with an engine that needs no map.

#include "runtime/service/serve.h"

#include <gtest/gtest.h>

#include <fstream>

#include "tests/runtime/service/service_support.h"

namespace panofix {
namespace {

using namespace service_test;

constexpr std::int64_t kTimeNs = 1'712'345'678'901'234'567;

class Serving : public ServiceTest {
 protected:
  FakeSource source_;
};

const auto kAny = [](const ReceivedResult&) { return true; };
auto HasTime(std::int64_t timestamp_ns) {
  return [=](const ReceivedResult& result) { return result.row.timestamp_ns == timestamp_ns; };
}

TEST_F(Serving, EveryAnswerBearsItsFramesTime) {
  Publisher camera = OpenPublisher();
  RunningServe serve(ServeOptionsFor(camera.endpoint()), source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  for (std::int64_t i = 0; i < 5; ++i) {
    const auto payload = PackFrame(kTimeNs + i, SampleJpeg());
    const auto result = SendUntil(camera, kFrameTopic, payload, poses, HasTime(kTimeNs + i));
    ASSERT_TRUE(result.has_value());
    EXPECT_EQ(result->row.status, FixStatus::kFix);
    EXPECT_EQ(result->bundle.id, SampleBundle().id);
    EXPECT_GT(result->decode_ms, 0);
  }
  EXPECT_TRUE(serve.Stop().ok());
}

TEST_F(Serving, FixesAreAlsoLocationFixes) {
  Publisher camera = OpenPublisher();
  RunningServe serve(ServeOptionsFor(camera.endpoint()), source_);
  Subscriber fixes = OpenSubscriber(serve.poses(), {kLocationFixTopic});
  std::optional<WireMessage> message;
  const auto payload = PackRawFrame(kTimeNs, SampleImage());
  EXPECT_TRUE(Eventually([&] {
    EXPECT_TRUE(camera.Send(kFrameTopic, payload).ok());
    return (message = ReceiveOne(fixes, 30)).has_value();
  }));
  ASSERT_TRUE(message.has_value());
  EXPECT_EQ(std::vector<std::uint8_t>(message->payload.bytes.begin(), message->payload.bytes.end()),
            PackLocationFix(SampleFix(kTimeNs), SampleBundle()));
}

TEST_F(Serving, WithoutAPublisherItWaitsAndStopsWhenTold) {
  RunningServe serve(ServeOptionsFor("tcp://127.0.0.1:9"), source_);
  SleepMs(200);
  EXPECT_FALSE(serve.ended());
  EXPECT_TRUE(serve.Stop().ok());
}

TEST_F(Serving, PublisherThatDiesAndReturnsIsPickedUp) {
  const TemporaryFolder folder;
  const std::string endpoint = "ipc://" + (folder.path() / "frames").string();
  auto camera = std::make_unique<Publisher>(OpenPublisher(endpoint));
  RunningServe serve(ServeOptionsFor(endpoint), source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  EXPECT_TRUE(SendUntil(*camera, kFrameTopic, PackFrame(1, SampleJpeg()), poses, HasTime(1)));
  camera.reset();
  camera = std::make_unique<Publisher>(OpenPublisher(endpoint));
  EXPECT_TRUE(SendUntil(*camera, kFrameTopic, PackFrame(2, SampleJpeg()), poses, HasTime(2)));
}

TEST_F(Serving, FrameThatDoesNotDecodeIsAnswered) {
  Publisher camera = OpenPublisher();
  RunningServe serve(ServeOptionsFor(camera.endpoint()), source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  auto jpeg = SampleJpeg();
  jpeg.resize(jpeg.size() / 2);
  const auto result = SendUntil(camera, kFrameTopic, PackFrame(kTimeNs, jpeg), poses, kAny);
  ASSERT_TRUE(result.has_value());
  EXPECT_EQ(result->row.timestamp_ns, kTimeNs);
  EXPECT_EQ(result->row.status, FixStatus::kNoFix);
  EXPECT_EQ(result->row.reason, "frame_undecodable");
}

TEST_F(Serving, FrameOfAnotherSizeIsAnswered) {
  Publisher camera = OpenPublisher();
  RunningServe serve(ServeOptionsFor(camera.endpoint()), source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  const auto result =
      SendUntil(camera, kFrameTopic, PackFrame(kTimeNs, SampleJpeg(32, 32)), poses, kAny);
  ASSERT_TRUE(result.has_value());
  EXPECT_EQ(result->row.reason, "frame_size_differs_from_camera");
}

TEST_F(Serving, PayloadThatDoesNotVerifyIsPassedOver) {
  Publisher camera = OpenPublisher();
  RunningServe serve(ServeOptionsFor(camera.endpoint()), source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  ASSERT_TRUE(SendUntil(camera, kFrameTopic, PackFrame(1, SampleJpeg()), poses, HasTime(1)));
  auto broken = PackFrame(2, SampleJpeg());
  broken[0] = 0xff;  // the root's offset
  const std::vector<std::uint8_t> empty, text{'h', 'e', 'l', 'l', 'o'};
  for (const auto& payload : {broken, empty, text}) {
    ASSERT_TRUE(camera.Send(kFrameTopic, payload).ok());
    SleepMs(20);
  }
  bool answered_broken = false;
  ASSERT_TRUE(SendUntil(camera, kFrameTopic, PackFrame(3, SampleJpeg()), poses,
                        [&](const ReceivedResult& result) {
                          answered_broken |= result.row.timestamp_ns == 2;
                          return result.row.timestamp_ns == 3;
                        }));
  EXPECT_FALSE(answered_broken);
}

TEST_F(Serving, ASlowEngineGetsTheNewestFrame) {
  Publisher camera = OpenPublisher();
  RunningServe serve(ServeOptionsFor(camera.endpoint()), source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  ASSERT_TRUE(SendUntil(camera, kFrameTopic, PackFrame(0, SampleJpeg()), poses, HasTime(0)));
  source_.work_ms = 150;
  const int before = source_.num_localized;
  constexpr int kNumFrames = 60;
  std::vector<std::int64_t> times;
  for (int i = 1; i <= kNumFrames; ++i) {
    ASSERT_TRUE(camera.Send(kFrameTopic, PackFrame(i, SampleJpeg())).ok());
    SleepMs(5);
  }
  EXPECT_TRUE(Eventually([&] {
    if (const auto message = ReceiveOne(poses)) {
      times.push_back(ValueOrThrow(UnpackResult(message->payload)).row.timestamp_ns);
    }
    return !times.empty() && times.back() == kNumFrames;
  }));
  EXPECT_TRUE(std::is_sorted(times.begin(), times.end()));
  EXPECT_LT(source_.num_localized - before, kNumFrames / 2);
}

TEST_F(Serving, CalibrationOfTheFeedIsTaken) {
  Publisher feed = OpenPublisher();
  ServeOptions options = ServeOptionsFor(feed.endpoint());
  options.camera_wait_s = 60;  // longer than patience: only the calibration lets frames through
  RunningServe serve(options, source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  Camera camera = SampleCamera();
  camera.fx_px *= 1.01;
  EXPECT_TRUE(Eventually([&] {
    EXPECT_TRUE(feed.Send(kCameraTopic, PackCalibration(1, camera)).ok());
    EXPECT_TRUE(feed.Send(kFrameTopic, PackFrame(kTimeNs, SampleJpeg())).ok());
    return ReceiveOne(poses, 30).has_value();
  }));
  ASSERT_EQ(source_.opened().size(), 2U);
  EXPECT_EQ(source_.opened()[0].fx_px, SampleCamera().fx_px);
  EXPECT_EQ(source_.opened()[1].fx_px, camera.fx_px);
}

TEST_F(Serving, CalibrationsThatDoNotFitAreRefused) {
  Publisher feed = OpenPublisher();
  RunningServe serve(ServeOptionsFor(feed.endpoint()), source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  const Camera large = Camera::FromHorizontalFov(128, 96, 70);
  const std::vector<std::uint8_t> garbage(40, 3);
  EXPECT_TRUE(Eventually([&] {
    EXPECT_TRUE(feed.Send(kCameraTopic, PackCalibration(1, large)).ok());
    EXPECT_TRUE(feed.Send(kCameraTopic, garbage).ok());
    EXPECT_TRUE(feed.Send(kFrameTopic, PackFrame(kTimeNs, SampleJpeg())).ok());
    return ReceiveOne(poses, 30).has_value() && source_.num_localized > 5;
  }));
  EXPECT_EQ(source_.opened().size(), 1U);
}

TEST_F(Serving, AGivenCameraIsKept) {
  const TemporaryFolder folder;
  Camera given = SampleCamera();
  given.fx_px *= 1.5;
  std::ofstream(folder.path() / "camera.yaml") << ToCameraYaml(given, "given");
  Publisher feed = OpenPublisher();
  ServeOptions options = ServeOptionsFor(feed.endpoint());
  options.camera = folder.path() / "camera.yaml";
  RunningServe serve(options, source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  EXPECT_TRUE(Eventually([&] {
    EXPECT_TRUE(feed.Send(kCameraTopic, PackCalibration(1, SampleCamera())).ok());
    EXPECT_TRUE(feed.Send(kFrameTopic, PackFrame(kTimeNs, SampleJpeg())).ok());
    return ReceiveOne(poses, 30).has_value() && source_.num_localized > 3;
  }));
  ASSERT_EQ(source_.opened().size(), 1U);
  EXPECT_EQ(source_.opened()[0].fx_px, given.fx_px);
}

TEST_F(Serving, StopsAfterSoManyAnswers) {
  Publisher camera = OpenPublisher();
  ServeOptions options = ServeOptionsFor(camera.endpoint());
  options.max_frames = 3;
  RunningServe serve(options, source_);
  EXPECT_TRUE(Eventually([&] {
    EXPECT_TRUE(camera.Send(kFrameTopic, PackFrame(1, SampleJpeg())).ok());
    SleepMs(5);
    return serve.ended();
  }));
  EXPECT_EQ(source_.num_localized, 3);
}

TEST_F(Serving, ErrorsNameTheEndpoint) {
  const Publisher taken = OpenPublisher();
  ServeOptions options = ServeOptionsFor("tcp://127.0.0.1:9");
  options.poses = taken.endpoint();
  Status status = ServeFrom(options, source_);
  EXPECT_EQ(status.code(), ErrorCode::kIo);
  EXPECT_NE(status.message().find(taken.endpoint()), std::string::npos);
  options = ServeOptionsFor("nonsense");
  status = ServeFrom(options, source_);
  EXPECT_EQ(status.code(), ErrorCode::kInvalidArgument);
  EXPECT_NE(status.message().find("nonsense"), std::string::npos);
  options = ServeOptionsFor("tcp://127.0.0.1:9");
  options.camera = "/no/such/camera.yaml";
  status = ServeFrom(options, source_);
  EXPECT_NE(status.message().find("/no/such/camera.yaml"), std::string::npos);
}

}  // namespace
}  // namespace panofix
