// What goes wrong beside a camera, over real sockets: the service answers on, and counts it.
#include <gtest/gtest.h>
#include <httplib.h>
#include <signal.h>
#include <sys/resource.h>

#include <zmq.hpp>

#include "runtime/mcap/mcap_reader.h"
#include "tests/runtime/service/service_support.h"

namespace panofix {
namespace {

using namespace service_test;

// From being told to the end; a sanitizer makes all of it slower.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr std::chrono::seconds kStop(10);
#else
constexpr std::chrono::seconds kStop(1);
#endif

auto HasTime(std::int64_t timestamp_ns) {
  return [=](const ReceivedResult& result) { return result.row.timestamp_ns == timestamp_ns; };
}

class Faults : public ServiceTest {
 protected:
  // A camera that connects to a feed that is bound.
  class ConnectingCamera {
   public:
    ConnectingCamera(zmq::context_t& context, const std::string& endpoint)
        : socket_(context, zmq::socket_type::pub) {
      socket_.set(zmq::sockopt::linger, 0);
      socket_.connect(endpoint);
    }
    void Send(std::string_view topic, std::span<const std::uint8_t> payload) {
      socket_.send(zmq::buffer(topic), zmq::send_flags::sndmore);
      socket_.send(zmq::buffer(payload.data(), payload.size()), zmq::send_flags::none);
    }

   private:
    zmq::socket_t socket_;
  };

  FakeSource source_;
  zmq::context_t context_;
  const TemporaryFolder folder_;
};

TEST_F(Faults, OtherTopicsAndGiantFramesArePassedOver) {
  Publisher camera = OpenPublisher();
  ServeOptions options = ServeOptionsFor(camera.endpoint());
  options.max_message_bytes = 100'000;
  RunningServe serve(options, source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  ASSERT_TRUE(SendUntil(camera, kFrameTopic, PackFrame(1, SampleJpeg()), poses, HasTime(1)));
  // Topics that begin as ours pass the subscription, but are others.
  ASSERT_TRUE(camera.Send("panofix.frame.v1.left", PackFrame(2, SampleJpeg())).ok());
  ASSERT_TRUE(camera.Send(kFrameTopic, PackRawFrame(3, SampleImage(1000, 700))).ok());
  bool answered_bad = false;
  EXPECT_TRUE(SendUntil(
      camera, kFrameTopic, PackFrame(4, SampleJpeg()), poses, [&](const ReceivedResult& result) {
        answered_bad |= result.row.timestamp_ns == 2 || result.row.timestamp_ns == 3;
        return result.row.timestamp_ns == 4;
      }));
  EXPECT_FALSE(answered_bad);
}

// A small message that promises a huge picture.
TEST_F(Faults, AHugePictureIsNotDecoded) {
  Publisher camera = OpenPublisher();
  RunningServe serve(ServeOptionsFor(camera.endpoint()), source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  const auto huge = PackFrame(5, SampleJpeg(4000, 3000));
  const auto result = SendUntil(camera, kFrameTopic, huge, poses, HasTime(5));
  ASSERT_TRUE(result.has_value());
  EXPECT_EQ(result->row.reason, "frame_undecodable");
}

TEST_F(Faults, AClockThatJumpsIsAnsweredWithItsOwnTimes) {
  Publisher camera = OpenPublisher();
  RunningServe serve(ServeOptionsFor(camera.endpoint()), source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  constexpr std::int64_t kYear_ns = 31'536'000'000'000'000;
  for (const std::int64_t time_ns :
       {50 * kYear_ns, std::int64_t{0}, 51 * kYear_ns, 50 * kYear_ns, std::int64_t{1}}) {
    EXPECT_TRUE(
        SendUntil(camera, kFrameTopic, PackFrame(time_ns, SampleJpeg()), poses, HasTime(time_ns)));
  }
}

TEST_F(Faults, TwoCamerasOnOneFeedDoNotBreakIt) {
  const std::string endpoint = "ipc://" + (folder_.path() / "feed*").string();
  RunningServe serve(ServeOptionsFor(endpoint), source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  ConnectingCamera first(context_, endpoint), second(context_, endpoint);
  std::vector<std::int64_t> counts(3);
  EXPECT_TRUE(Eventually([&] {
    first.Send(kFrameTopic, PackFrame(1, SampleJpeg()));
    SleepMs(3);
    second.Send(kFrameTopic, PackFrame(2, SampleJpeg()));
    if (const auto message = ReceiveOne(poses, 10)) {
      ++counts.at(std::size_t(ValueOrThrow(UnpackResult(message->payload)).row.timestamp_ns));
    }
    return counts[1] > 3 && counts[2] > 3;
  }));
}

// Each calibration in turn would have the map opened anew.
TEST_F(Faults, OfTwoCamerasThatDisagreeTheOneInUseStaysUntilItIsGone) {
  const std::string endpoint = "ipc://" + (folder_.path() / "feed*").string();
  ServeOptions options = ServeOptionsFor(endpoint);
  options.camera_wait_s = 60;  // only a calibration lets frames through
  options.http_port = 0;
  std::atomic<int> port{0};
  options.on_http = [&](int bound) { port = bound; };
  const auto num_rivals = [&] {
    const std::string name = "\npanofix_calibrations_rival_total ";
    const auto page = httplib::Client("127.0.0.1", port).Get("/metrics");
    const auto at = page ? page->body.find(name) : std::string::npos;
    return at == std::string::npos ? -1 : std::stoi(page->body.substr(at + name.size()));
  };
  RunningServe serve(options, source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  auto first = std::make_optional<ConnectingCamera>(context_, endpoint);
  ConnectingCamera second(context_, endpoint);
  const auto of_first = PackCalibration(1, Camera::FromHorizontalFov(64, 48, 60));
  const auto of_second = PackCalibration(1, Camera::FromHorizontalFov(64, 48, 80));
  EXPECT_TRUE(Eventually([&] {
    first->Send(kCameraTopic, of_first);
    SleepMs(5);
    return source_.opened().size() == 2;
  }));
  SetLogLevel("warning");
  testing::internal::CaptureStderr();
  EXPECT_TRUE(Eventually([&] {
    first->Send(kCameraTopic, of_first);
    second.Send(kCameraTopic, of_second);
    first->Send(kFrameTopic, PackFrame(1, SampleJpeg()));
    SleepMs(5);
    return num_rivals() >= 20;
  }));
  const std::string log = testing::internal::GetCapturedStderr();
  SetLogLevel("off");
  EXPECT_NE(log.find("two cameras publish on one feed"), std::string::npos) << log;
  ASSERT_EQ(source_.opened().size(), 2U) << "the map was opened for the other camera";
  EXPECT_EQ(source_.opened()[1].fx_px, Camera::FromHorizontalFov(64, 48, 60).fx_px);
  // Once the first is gone, the other is taken.
  first.reset();
  EXPECT_TRUE(Eventually([&] {
    second.Send(kCameraTopic, of_second);
    SleepMs(20);
    return source_.opened().size() == 3;
  }));
  EXPECT_EQ(source_.opened().at(2).fx_px, Camera::FromHorizontalFov(64, 48, 80).fx_px);
}

// Its messages pile up to the queue's bound, and nobody else feels it.
TEST_F(Faults, ASubscriberThatNeverReadsHoldsNobodyUp) {
  Publisher camera = OpenPublisher();
  RunningServe serve(ServeOptionsFor(camera.endpoint()), source_);
  zmq::socket_t stuck(context_, zmq::socket_type::sub);
  stuck.set(zmq::sockopt::linger, 0);
  stuck.set(zmq::sockopt::rcvhwm, 1);
  stuck.set(zmq::sockopt::subscribe, "");
  stuck.connect(serve.poses());
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  const auto frame = PackFrame(1, SampleJpeg());
  int num_answers = 0;
  EXPECT_TRUE(SendUntil(camera, kFrameTopic, frame, poses,
                        [&](const ReceivedResult&) { return ++num_answers == 500; }));
}

// One that takes a message now and then gets what it can take, and the others all.
TEST_F(Faults, ASlowSubscriberSlowsNobody) {
  Publisher camera = OpenPublisher();
  RunningServe serve(ServeOptionsFor(camera.endpoint()), source_);
  zmq::socket_t slow(context_, zmq::socket_type::sub);
  slow.set(zmq::sockopt::linger, 0);
  slow.set(zmq::sockopt::rcvhwm, 1);
  slow.set(zmq::sockopt::subscribe, "");
  slow.connect(serve.poses());
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  const auto frame = PackFrame(1, SampleJpeg());
  int num_answers = 0, num_slow = 0;
  EXPECT_TRUE(SendUntil(camera, kFrameTopic, frame, poses, [&](const ReceivedResult&) {
    zmq::message_t part;
    if (++num_answers % 20 == 0 && slow.recv(part, zmq::recv_flags::dontwait)) ++num_slow;
    return num_answers >= 300 && num_slow > 2;
  }));
}

TEST_F(Faults, AFullDiskEndsTheRecordingAndNothingElse) {
  constexpr rlim_t kLimit_bytes = 60'000;
  rlimit old{};
  getrlimit(RLIMIT_FSIZE, &old);
  const rlimit small{kLimit_bytes, old.rlim_max};
  auto* const handler = signal(SIGXFSZ, SIG_IGN);
  setrlimit(RLIMIT_FSIZE, &small);
  Publisher camera = OpenPublisher();
  ServeOptions options = ServeOptionsFor(camera.endpoint());
  options.record = folder_.path() / "run.mcap";
  {
    RunningServe serve(options, source_);
    Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
    int num_answers = 0;
    EXPECT_TRUE(SendUntil(camera, kFrameTopic, PackFrame(1, SampleJpeg()), poses,
                          [&](const ReceivedResult&) { return ++num_answers == 60; }));
    EXPECT_FALSE(serve.ended());
  }
  setrlimit(RLIMIT_FSIZE, &old);
  signal(SIGXFSZ, handler);
  EXPECT_LE(std::filesystem::file_size(*options.record), kLimit_bytes);
  auto reader = ValueOrThrow(McapReader::Open(*options.record));
  int num_messages = 0;
  while (true) {
    const auto record = ValueOrThrow(reader.Next());
    if (!record) break;
    num_messages += record->is_message ? 1 : 0;
  }
  EXPECT_GT(num_messages, 5);
}

TEST_F(Faults, ToldToStopInTheMiddleOfAFrameItLeavesIt) {
  Publisher camera = OpenPublisher();
  RunningServe serve(ServeOptionsFor(camera.endpoint()), source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  ASSERT_TRUE(SendUntil(camera, kFrameTopic, PackFrame(1, SampleJpeg()), poses, HasTime(1)));
  // What was sent meanwhile is worked off.
  int seen = -1;
  EXPECT_TRUE(Eventually([&] {
    SleepMs(100);
    return std::exchange(seen, source_.num_localized.load()) == source_.num_localized;
  }));
  source_.work_ms = 300'000;  // longer than this test may take
  const int before = source_.num_begun;
  ASSERT_TRUE(camera.Send(kFrameTopic, PackFrame(2, SampleJpeg())).ok());
  EXPECT_TRUE(Eventually([&] {
    SleepMs(1);
    return source_.num_begun > before;
  }));
  const auto told = std::chrono::steady_clock::now();
  EXPECT_TRUE(serve.Stop().ok());
  EXPECT_LT(std::chrono::steady_clock::now() - told, kStop);
  EXPECT_EQ(source_.num_localized, seen);
}

}  // namespace
}  // namespace panofix
