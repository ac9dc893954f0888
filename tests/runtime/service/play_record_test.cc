// The recorded camera and the pose recorder over real sockets.

#include <gtest/gtest.h>

#include <fstream>
#include <future>
#include <iterator>

#include "runtime/service/play.h"
#include "runtime/service/record.h"
#include "tests/runtime/service/service_support.h"

namespace panofix {
namespace {

using namespace service_test;

// Fast enough for short tests, slow enough that a queue of 64 does not overflow.
constexpr double kRateHz = 200;

class Playing : public ServiceTest {
 protected:
  PlayOptions Options() {
    PlayOptions options;
    options.drive = folder_.path() / "drive";
    options.bind = "ipc://" + (folder_.path() / "frames").string();
    options.rate_hz = kRateHz;
    options.wait_for_subscriber = true;
    options.subscriber_timeout_s = static_cast<double>(kPatience.count());
    return options;
  }
  static std::future<Status> Start(const PlayOptions& options) {
    return std::async(std::launch::async, [options] { return Play(options); });
  }
  TemporaryFolder folder_;
};
class Recording : public Playing {};

std::vector<std::uint8_t> FileBytes(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

TEST_F(Playing, EveryFrameArrivesAsStored) {
  constexpr int kNumFrames = 12;
  WriteDrive(folder_.path() / "drive", kNumFrames);
  const PlayOptions options = Options();
  Subscriber subscriber = OpenSubscriber(options.bind, {kFrameTopic, kCameraTopic});
  auto played = Start(options);
  std::vector<IncomingFrame> frames;
  int num_calibrations = 0;
  EXPECT_TRUE(Eventually([&] {
    if (const auto message = ReceiveOne(subscriber)) {
      if (message->topic == kFrameTopic) {
        frames.push_back(ValueOrThrow(UnpackFrame(message->payload)));
      } else if (frames.empty()) {
        ++num_calibrations;
        EXPECT_EQ(ValueOrThrow(UnpackCalibration(message->payload)).fx_px, SampleCamera().fx_px);
      }
    }
    return frames.size() == kNumFrames;
  }));
  EXPECT_TRUE(played.get().ok());
  EXPECT_GE(num_calibrations, 1) << "the calibration comes before the first frame";
  ASSERT_EQ(frames.size(), kNumFrames);
  for (int i = 0; i < kNumFrames; ++i) {
    const IncomingFrame& frame = frames[static_cast<std::size_t>(i)];
    EXPECT_EQ(frame.timestamp_ns, kDriveStartNs + i * kDriveStepNs);
    EXPECT_EQ(std::vector<std::uint8_t>(frame.data.begin(), frame.data.end()),
              FileBytes(options.drive / ("frame_" + std::to_string(i) + ".jpg")));
  }
}

TEST_F(Playing, TimeGoesOnWhereTheDriveBeginsAgain) {
  WriteDrive(folder_.path() / "drive", 3);
  PlayOptions options = Options();
  options.loop = true;
  Subscriber subscriber = OpenSubscriber(options.bind, {kFrameTopic});
  auto played = Start(options);
  std::vector<std::int64_t> times;
  EXPECT_TRUE(Eventually([&] {
    if (const auto message = ReceiveOne(subscriber)) {
      times.push_back(ValueOrThrow(UnpackFrame(message->payload)).timestamp_ns);
    }
    return times.size() >= 8;
  }));
  RequestCancel();
  EXPECT_TRUE(played.get().ok());
  EXPECT_TRUE(std::adjacent_find(times.begin(), times.end(), std::greater_equal<>()) ==
              times.end());
}

TEST_F(Playing, ALateSubscriberGetsTheCalibration) {
  WriteDrive(folder_.path() / "drive", 2);
  PlayOptions options = Options();
  options.loop = true;
  options.rate_hz = 0.01;  // waits for the second frame
  options.wait_for_subscriber = false;
  auto played = Start(options);
  Subscriber subscriber = OpenSubscriber(options.bind, {kCameraTopic});
  EXPECT_TRUE(Eventually([&] { return ReceiveOne(subscriber).has_value(); }));
  RequestCancel();
  EXPECT_TRUE(played.get().ok());
}

TEST_F(Playing, RestampedFramesBearTheTimeOfSending) {
  WriteDrive(folder_.path() / "drive", 1);
  PlayOptions options = Options();
  options.restamp_now = true;
  Subscriber subscriber = OpenSubscriber(options.bind, {kFrameTopic});
  const std::int64_t before = std::chrono::duration_cast<std::chrono::nanoseconds>(
                                  std::chrono::system_clock::now().time_since_epoch())
                                  .count();
  auto played = Start(options);
  std::optional<WireMessage> message;
  EXPECT_TRUE(Eventually([&] { return (message = ReceiveOne(subscriber)).has_value(); }));
  EXPECT_TRUE(played.get().ok());
  EXPECT_GE(ValueOrThrow(UnpackFrame(message.value().payload)).timestamp_ns, before);
}

TEST_F(Playing, NoSubscriberInTimeIsSaid) {
  WriteDrive(folder_.path() / "drive", 1);
  PlayOptions options = Options();
  options.subscriber_timeout_s = 0.1;
  const Status status = Play(options);
  EXPECT_EQ(status.code(), ErrorCode::kNotFound);
  EXPECT_NE(status.message().find(options.bind), std::string::npos);
}

TEST_F(Playing, ErrorsNameTheFile) {
  PlayOptions options = Options();
  options.wait_for_subscriber = false;
  EXPECT_FALSE(Play(options).ok());  // no drive
  WriteDrive(options.drive, 2);
  std::ofstream(options.drive / "frame_1.jpg") << "GIF89a is no JPEG";
  Status status = Play(options);
  EXPECT_EQ(status.code(), ErrorCode::kBadData);
  EXPECT_NE(status.message().find("frame_1.jpg"), std::string::npos);
  std::filesystem::remove(options.drive / "frame_1.jpg");
  status = Play(options);
  EXPECT_EQ(status.code(), ErrorCode::kNotFound);
  EXPECT_NE(status.message().find("frame_1.jpg"), std::string::npos);
  options.rate_hz = 0;
  EXPECT_EQ(Play(options).code(), ErrorCode::kInvalidArgument);
}

TEST_F(Recording, RowsAreThoseOfTheMessages) {
  Publisher runtime = OpenPublisher();
  RecordOptions options;
  options.poses = runtime.endpoint();
  options.out = folder_.path() / "poses.csv";
  options.count = 3;
  auto recorded = std::async(std::launch::async, [options] { return Record(options); });
  ASSERT_TRUE(Eventually([&] { return !runtime.TakeSubscriptions(50).empty(); }));
  const auto bundle = SampleBundle();
  ASSERT_TRUE(runtime.Send(kPoseTopic, PackResult(SampleFix(10), bundle)).ok());
  ASSERT_TRUE(runtime.Send(kPoseTopic, std::vector<std::uint8_t>(100, 1)).ok());  // passed over
  ASSERT_TRUE(runtime.Send(kPoseTopic, PackResult(SampleNoFix(20), bundle)).ok());
  ASSERT_TRUE(runtime.Send(kPoseTopic, PackResult(SampleFix(30), bundle)).ok());
  const Status status = recorded.get();
  ASSERT_TRUE(status.ok()) << status.message();
  const auto rows = ReadPosesCsv(options.out);
  ASSERT_TRUE(rows.ok()) << rows.status().message();
  ASSERT_EQ(rows->size(), 3U);
  EXPECT_EQ((*rows)[0].timestamp_ns, 10);
  EXPECT_EQ((*rows)[0].num_inliers, 87);
  EXPECT_TRUE((*rows)[0].pose.has_value());
  EXPECT_EQ((*rows)[1].reason, "too_few_inliers");
  EXPECT_EQ((*rows)[2].timestamp_ns, 30);
  EXPECT_FALSE(std::filesystem::exists(options.out.string() + ".part"));
}

TEST_F(Recording, RowsAreOnDiskAsTheyComeAndKeptAtAStop) {
  Publisher runtime = OpenPublisher();
  RecordOptions options;
  options.poses = runtime.endpoint();
  options.out = folder_.path() / "poses.csv";
  auto recorded = std::async(std::launch::async, [options] { return Record(options); });
  ASSERT_TRUE(Eventually([&] { return !runtime.TakeSubscriptions(50).empty(); }));
  ASSERT_TRUE(runtime.Send(kPoseTopic, PackResult(SampleFix(10), SampleBundle())).ok());
  EXPECT_TRUE(Eventually([&] {
    SleepMs(5);
    const auto rows = ReadPosesCsv(options.out.string() + ".part");
    return rows.ok() && rows->size() == 1;
  }));
  EXPECT_FALSE(std::filesystem::exists(options.out));
  RequestCancel();
  EXPECT_TRUE(recorded.get().ok());
  EXPECT_EQ(ValueOrThrow(ReadPosesCsv(options.out)).size(), 1U);
}

TEST_F(Recording, SilenceIsAnErrorAndLeavesNoFile) {
  RecordOptions options;
  options.poses = "tcp://127.0.0.1:9";
  options.out = folder_.path() / "poses.csv";
  options.idle_timeout_s = 0.2;
  const Status status = Record(options);
  EXPECT_EQ(status.code(), ErrorCode::kNotFound);
  EXPECT_NE(status.message().find(options.poses), std::string::npos);
  EXPECT_TRUE(std::filesystem::is_empty(folder_.path()));
}

TEST_F(Recording, FolderThatIsNotThereIsSaid) {
  RecordOptions options;
  options.poses = "tcp://127.0.0.1:9";
  options.out = folder_.path() / "none/poses.csv";
  const Status status = Record(options);
  EXPECT_EQ(status.code(), ErrorCode::kIo);
  EXPECT_NE(status.message().find("none/poses.csv"), std::string::npos);
}

// The whole wire: camera, service and recorder.
TEST_F(Recording, APlayedDriveBecomesAFileOfPoses) {
  constexpr int kNumFrames = 5;
  WriteDrive(folder_.path() / "drive", kNumFrames);
  PlayOptions play = Options();
  play.rate_hz = 10;  // slow enough for one answer a frame
  FakeSource source;
  ServeOptions serve_options = ServeOptionsFor(play.bind);
  serve_options.poses = "ipc://" + (folder_.path() / "poses").string();
  serve_options.camera_wait_s = 5;
  RecordOptions record;
  record.poses = serve_options.poses;
  record.out = folder_.path() / "poses.csv";
  record.count = kNumFrames;
  // The recorder first: its subscription is in place when the first pose leaves.
  auto recorded = std::async(std::launch::async, [record] { return Record(record); });
  RunningServe serve(serve_options, source);
  SleepMs(500);  // five times the recorder's reconnect interval
  const Status played = Play(play);
  ASSERT_TRUE(played.ok()) << played.message();
  const Status status = recorded.get();
  ASSERT_TRUE(status.ok()) << status.message();
  const auto rows = ValueOrThrow(ReadPosesCsv(record.out));
  ASSERT_EQ(rows.size(), static_cast<std::size_t>(kNumFrames));
  for (int i = 0; i < kNumFrames; ++i) {
    EXPECT_EQ(rows[static_cast<std::size_t>(i)].timestamp_ns, kDriveStartNs + i * kDriveStepNs);
  }
  EXPECT_EQ(source.opened().size(), 1U);  // the drive's camera is the bundle's
}

}  // namespace
}  // namespace panofix
