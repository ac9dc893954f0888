// Runs that are recorded and replayed, with an engine whose answers depend on all it has seen.
#include <gtest/gtest.h>

#include "runtime/mcap/mcap_reader.h"
#include "runtime/service/replay.h"
#include "runtime/service/session_recorder.h"
#include "tests/runtime/service/service_support.h"

namespace panofix {
namespace {

using namespace service_test;

// Asks whether its time is up ten times a frame; its answer tells how far it came, now and before.
class CountingEngine : public FrameEngine {
 public:
  explicit CountingEngine(int step_ms, Camera camera) : step_ms_(step_ms), camera_(camera) {}
  FrameResult Localize(std::int64_t timestamp_ns, const GrayImage& frame,
                       const TimeIsUp& time_is_up) override {
    for (int step = 0; step < 10; ++step) {
      if (time_is_up && time_is_up()) {
        FrameResult late = SampleNoFix(timestamp_ns);
        late.reason = "deadline";
        late.num_inliers = num_steps_;
        return late;
      }
      ++num_steps_;
      SleepMs(step_ms_);
    }
    FrameResult result = SampleFix(timestamp_ns);
    result.num_inliers = num_steps_;
    result.pose->position_in_map.x() += 0.1 * num_steps_ + frame.pixels[0];
    result.latency.total_ms = static_cast<double>(step_ms_);
    return result;
  }
  FrameResult Undecodable(std::int64_t timestamp_ns) const override {
    FrameResult result = SampleNoFix(timestamp_ns);
    result.reason = "frame_undecodable";
    return result;
  }
  const BundleIdentity& bundle() const override { return bundle_; }
  const Camera& camera() const override { return camera_; }
  void Forget() override { num_steps_ = 0; }
  Result<std::unique_ptr<FrameEngine>> Another() const override {
    return std::unique_ptr<FrameEngine>(std::make_unique<CountingEngine>(step_ms_, camera_));
  }
  MapFacts facts() const override { return {}; }

 private:
  const int step_ms_;
  const Camera camera_;
  const BundleIdentity bundle_ = SampleBundle();
  int num_steps_ = 0;
};

class CountingSource : public EngineSource {
 public:
  Result<Camera> BundleCamera() override { return SampleCamera(); }
  Result<std::unique_ptr<FrameEngine>> Open(const Camera& camera) override {
    return std::unique_ptr<FrameEngine>(std::make_unique<CountingEngine>(4, camera));
  }
};

class RunRecording : public ServiceTest {
 protected:
  // Plays frames of changing content, one undecodable, through a service with a deadline that cuts
  // many of them off; the answers.
  std::vector<PoseRow> RecordRun(double deadline_ms) {
    Publisher camera = OpenPublisher();
    ServeOptions options = ServeOptionsFor(camera.endpoint());
    options.record = file_;
    options.deadline_ms = deadline_ms;
    RunningServe serve(options, source_);
    Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
    std::vector<PoseRow> rows;
    std::int64_t time_ns = 1;
    EXPECT_TRUE(Eventually([&] {
      auto jpeg = SampleJpeg();
      if (time_ns % 7 == 0) jpeg.resize(jpeg.size() / 2);
      const auto payload =
          time_ns / 8 % 2 == 0 ? PackRawFrame(time_ns, SampleImage()) : PackFrame(time_ns, jpeg);
      EXPECT_TRUE(camera.Send(kFrameTopic, payload).ok());
      ++time_ns;
      if (const auto message = ReceiveOne(poses, 15)) {
        rows.push_back(ValueOrThrow(UnpackResult(message->payload)).row);
      }
      return rows.size() >= 40;
    }));
    EXPECT_TRUE(serve.Stop().ok());
    return rows;
  }
  [[nodiscard]] ReplayReport ReplayWith(int step_ms, std::string* map_id = nullptr) const {
    return ValueOrThrow(
        Replay(file_, [&](const std::string& id, const Camera& camera, const LocalizerOptions&) {
          if (map_id != nullptr) *map_id = id;
          return Result<std::unique_ptr<FrameEngine>>(
              std::make_unique<CountingEngine>(step_ms, camera));
        }));
  }

  const TemporaryFolder folder_;
  const std::filesystem::path file_ = folder_.path() / "run.mcap";
  CountingSource source_;
};

TEST_F(RunRecording, AReplayIsTheSameBitForBitDeadlinesIncluded) {
  const std::vector<PoseRow> rows = RecordRun(43);
  std::string map_id;
  const ReplayReport report = ReplayWith(0, &map_id);
  EXPECT_EQ(map_id, SampleBundle().id);
  EXPECT_EQ(report.num_different, 0) << report.first_different_ns;
  EXPECT_FALSE(report.was_cut);
  ASSERT_GE(report.rows.size(), rows.size());
  int num_late = 0, num_undecodable = 0;
  for (const PoseRow& row : report.rows) {
    num_late += row.reason == "deadline" ? 1 : 0;
    num_undecodable += row.reason == "frame_undecodable" ? 1 : 0;
  }
  // Without both kinds this would show little.
  EXPECT_GT(num_late, 0);
  EXPECT_GT(num_undecodable, 0);
}

// The disk stands still for a while; nobody waits for it.
TEST_F(RunRecording, ASlowDiskLeavesAGapThatIsCountedAndNotCompared) {
  ServiceMonitor monitor;
  std::atomic<bool> is_stuck{true};
  RecorderLimits limits;
  limits.finish_patience_s = 60;
  limits.max_waiting_bytes = 20'000;
  limits.before_write = [&] {
    while (is_stuck) SleepMs(1);
  };
  auto recorder = ValueOrThrow(SessionRecorder::Create(file_, {}, monitor, limits));
  CountingEngine engine(0, SampleCamera());
  recorder->AddEngine(engine.bundle(), engine.camera());
  const auto answer = [&](std::int64_t time_ns) {
    const WireBytes payload = WireBytes::Copy(PackFrame(time_ns, SampleJpeg()));
    const IncomingFrame frame = ValueOrThrow(UnpackFrame(payload));
    const FrameResult result = engine.Localize(time_ns, ValueOrThrow(ConvertFrame(frame)), {});
    recorder->AddAnswer(frame, PackResult(result, engine.bundle()), 0);
  };
  for (std::int64_t t = 1; t <= 50; ++t) answer(t);
  const std::int64_t num_lost = monitor.Snapshot().num_not_recorded;
  EXPECT_GT(num_lost, 0);
  is_stuck = false;
  EXPECT_TRUE(Eventually([&] {
    SleepMs(1);
    return monitor.Snapshot().num_recorded >= 2 + 100 - num_lost;
  }));
  for (std::int64_t t = 51; t <= 55; ++t) answer(t);
  recorder->Finish();
  const ReplayReport report = ReplayWith(0);
  EXPECT_FALSE(report.was_cut);
  EXPECT_EQ(report.num_different, 0);
  EXPECT_EQ(report.num_frames, 55 - num_lost / 2);
  EXPECT_EQ(report.num_not_compared, 5);
}

TEST_F(RunRecording, ADiskThatStandsStillDoesNotHoldUpTheEnd) {
  // The thread that waits for the disk may outlive all else.
  const auto is_stuck = std::make_shared<std::atomic<bool>>(true);
  {
    ServiceMonitor monitor;
    RecorderLimits limits;
    limits.finish_patience_s = 0.05;
    limits.before_write = [is_stuck] {
      while (*is_stuck) SleepMs(1);
    };
    auto recorder = ValueOrThrow(SessionRecorder::Create(file_, {}, monitor, limits));
    CountingEngine engine(0, SampleCamera());
    recorder->AddEngine(engine.bundle(), engine.camera());
    const WireBytes payload = WireBytes::Copy(PackFrame(1, SampleJpeg()));
    const IncomingFrame frame = ValueOrThrow(UnpackFrame(payload));
    for (int i = 0; i < 5; ++i)
      recorder->AddAnswer(frame, PackResult(SampleFix(1), engine.bundle()), 0);
    SetLogLevel("warning");
    testing::internal::CaptureStderr();
    recorder->Finish();
    recorder.reset();
    const std::string log = testing::internal::GetCapturedStderr();
    SetLogLevel("off");
    EXPECT_NE(log.find(file_.string() + ": the disk does not answer"), std::string::npos) << log;
    EXPECT_EQ(monitor.Snapshot().num_not_recorded, 10);
  }
  EXPECT_TRUE(ReplayWith(0).was_cut);
  // A disk that wakes up in time still gets the end.
  *is_stuck = false;
  EXPECT_TRUE(Eventually([&] {
    SleepMs(5);
    return !ReplayWith(0).was_cut;
  }));
}

TEST_F(RunRecording, ADifferentAnswerIsFound) {
  RecordRun(0);
  class Wrong : public CountingEngine {
   public:
    using CountingEngine::CountingEngine;
    FrameResult Localize(std::int64_t timestamp_ns, const GrayImage& frame,
                         const TimeIsUp& time_is_up) override {
      FrameResult result = CountingEngine::Localize(timestamp_ns, frame, time_is_up);
      if (result.pose && ++num_ == 5) result.pose->position.lat_deg += 1e-13;
      return result;
    }
    int num_ = 0;
  };
  const auto report =
      Replay(file_, [](const std::string&, const Camera& camera, const LocalizerOptions&) {
        return Result<std::unique_ptr<FrameEngine>>(std::make_unique<Wrong>(0, camera));
      });
  ASSERT_TRUE(report.ok());
  EXPECT_EQ(report->num_different, 1);
  EXPECT_GT(report->first_different_ns, 0);
}

// A signed map is often replayed without its keys at hand.
TEST_F(RunRecording, WhetherASignatureIsVerifiedIsNotCompared) {
  RecordRun(0);
  class Signed : public CountingEngine {
   public:
    using CountingEngine::CountingEngine;
    FrameResult Localize(std::int64_t timestamp_ns, const GrayImage& frame,
                         const TimeIsUp& time_is_up) override {
      FrameResult result = CountingEngine::Localize(timestamp_ns, frame, time_is_up);
      result.map_is_unsigned = false;
      return result;
    }
    const BundleIdentity& bundle() const override { return signed_; }
    BundleIdentity signed_ = [] {
      BundleIdentity bundle = SampleBundle();
      bundle.is_signed = true;
      return bundle;
    }();
  };
  const auto report =
      Replay(file_, [](const std::string&, const Camera& camera, const LocalizerOptions&) {
        return Result<std::unique_ptr<FrameEngine>>(std::make_unique<Signed>(0, camera));
      });
  ASSERT_TRUE(report.ok());
  EXPECT_EQ(report->num_different, 0);
}

TEST_F(RunRecording, AfterACrashWhatWasWrittenReplays) {
  RecordRun(0);
  std::filesystem::resize_file(file_, std::filesystem::file_size(file_) * 2 / 3);
  const ReplayReport report = ReplayWith(0);
  EXPECT_TRUE(report.was_cut);
  EXPECT_EQ(report.num_different, 0);
  EXPECT_GT(report.num_frames, 10);
}

TEST_F(RunRecording, InAFolderEachRunHasAFileOfItsOwn) {
  Publisher camera = OpenPublisher();
  ServeOptions options = ServeOptionsFor(camera.endpoint());
  options.record = folder_.path();
  { RunningServe serve(options, source_); }
  int num_files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder_.path())) {
    EXPECT_EQ(entry.path().extension(), ".mcap");
    ++num_files;
  }
  EXPECT_EQ(num_files, 1);
}

TEST_F(RunRecording, AFileThatIsThereIsKept) {
  RecordRun(0);
  ServeOptions options = ServeOptionsFor("tcp://127.0.0.1:9");
  options.record = file_;
  const Status status = ServeFrom(options, source_);
  EXPECT_EQ(status.code(), ErrorCode::kInvalidArgument);
  EXPECT_NE(status.message().find(file_.string()), std::string::npos);
}

TEST_F(RunRecording, AMapThatIsNotThereIsNamed) {
  RecordRun(0);
  const auto report = Replay(file_, OpenerOver({}, {}));
  ASSERT_FALSE(report.ok());
  EXPECT_EQ(report.status().code(), ErrorCode::kNotFound);
  EXPECT_NE(report.status().message().find(SampleBundle().id), std::string::npos);
}

}  // namespace
}  // namespace panofix
