// A newer map while frames come in, with engines that need none.
#include <gtest/gtest.h>
#include <httplib.h>

#include "tests/runtime/service/service_support.h"

namespace panofix {
namespace {

using namespace service_test;

class Swapping : public ServiceTest {
 protected:
  static ServeOptions Options(const std::string& frames) {
    ServeOptions options = ServeOptionsFor(frames);
    options.update_interval_s = 0.01;
    return options;
  }
  // Sends frames until one is answered from this build; how many were answered on the way.
  int AnswersUntilBuild(Publisher& camera, Subscriber& poses, std::int64_t build) {
    int num_answers = 0;
    EXPECT_TRUE(SendUntil(camera, kFrameTopic, PackFrame(5, SampleJpeg()), poses,
                          [&](const ReceivedResult& result) {
                            ++num_answers;
                            return result.bundle.build == build;
                          }));
    return num_answers;
  }
  FakeSource source_;
};

TEST_F(Swapping, FramesAreAnsweredWhileTheNewerMapOpens) {
  Publisher camera = OpenPublisher();
  RunningServe serve(Options(camera.endpoint()), source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  AnswersUntilBuild(camera, poses, SampleBundle().build);
  source_.update_ms = 1000;
  source_.next_build = 43;
  EXPECT_GT(AnswersUntilBuild(camera, poses, 43), 5);
  // Back again, as a rollback does.
  source_.update_ms = 0;
  source_.next_build = 42;
  AnswersUntilBuild(camera, poses, 42);
}

// The memory of a large map is not freed in no time.
TEST_F(Swapping, FramesAreAnsweredWhileTheOldMapIsFreed) {
  Publisher camera = OpenPublisher();
  RunningServe serve(Options(camera.endpoint()), source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  AnswersUntilBuild(camera, poses, SampleBundle().build);
  source_.may_free = false;
  for (const std::int64_t build : {43, 44}) {
    source_.next_build = build;
    for (int i = 0; i < 5; ++i) AnswersUntilBuild(camera, poses, build);
  }
  EXPECT_EQ(source_.num_freed, 0);
  source_.may_free = true;
  EXPECT_TRUE(Eventually([&] {
    SleepMs(1);
    return source_.num_freed == 2;
  }));
}

// So it is with a calibration of the feed, for which the map is opened anew.
TEST_F(Swapping, FramesAreAnsweredWhileTheEngineOfAnotherCameraIsFreed) {
  Publisher camera = OpenPublisher();
  RunningServe serve(Options(camera.endpoint()), source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  AnswersUntilBuild(camera, poses, SampleBundle().build);
  source_.may_free = false;
  EXPECT_TRUE(Eventually([&] {
    EXPECT_TRUE(
        camera.Send(kCameraTopic, PackCalibration(2, Camera::FromHorizontalFov(64, 48, 60))).ok());
    SleepMs(5);
    return source_.opened().size() == 2;
  }));
  for (int i = 0; i < 5; ++i) AnswersUntilBuild(camera, poses, SampleBundle().build);
  EXPECT_EQ(source_.num_freed, 0);
  source_.may_free = true;
}

TEST_F(Swapping, AMapThatDoesNotOpenChangesNothing) {
  Publisher camera = OpenPublisher();
  RunningServe serve(Options(camera.endpoint()), source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  source_.next_build = -1;
  EXPECT_TRUE(Eventually([&] {
    SleepMs(5);
    return source_.num_failed == 1;
  }));
  for (int i = 0; i < 5; ++i) AnswersUntilBuild(camera, poses, SampleBundle().build);
  EXPECT_FALSE(serve.ended());
  source_.next_build = 44;
  AnswersUntilBuild(camera, poses, 44);
}

TEST_F(Swapping, ToldToStopWhileAMapOpensItStops) {
  RunningServe serve(Options("tcp://127.0.0.1:9"), source_);
  source_.update_ms = 300;
  source_.next_build = 43;
  EXPECT_TRUE(Eventually([&] {
    SleepMs(1);
    return source_.num_updates > 0;
  }));
  EXPECT_TRUE(serve.Stop().ok());
}

TEST_F(Swapping, AMapThatDoesNotOpenIsTriedAgainLessAndLessOften) {
  Publisher camera = OpenPublisher();
  ServeOptions options = Options(camera.endpoint());
  options.retry_wait_s = 0.05;
  options.max_retry_wait_s = 0.4;
  options.http_port = 0;
  std::atomic<int> port{0};
  options.on_http = [&](int bound) { port = bound; };
  RunningServe serve(options, source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  AnswersUntilBuild(camera, poses, SampleBundle().build);
  SetLogLevel("error");
  testing::internal::CaptureStderr();
  source_.next_build = -1;
  EXPECT_TRUE(Eventually([&] {
    // The one before answers on.
    AnswersUntilBuild(camera, poses, SampleBundle().build);
    const auto metrics = httplib::Client("127.0.0.1", port).Get("/metrics");
    const std::string name = "\npanofix_map_swaps_failed_total ";
    const auto at = metrics ? metrics->body.find(name) : std::string::npos;
    return at != std::string::npos && std::stoi(metrics->body.substr(at + name.size())) >= 5;
  }));
  const std::string log = testing::internal::GetCapturedStderr();
  SetLogLevel("off");
  for (const char* wait : {" 0.05 s", " 0.1 s", " 0.2 s", " 0.4 s"})
    EXPECT_NE(log.find(std::string("tried again in") + wait), std::string::npos) << log;
  EXPECT_EQ(log.find("0.8 s"), std::string::npos) << log;
  // The same map opens after all.
  source_.is_mended = true;
  AnswersUntilBuild(camera, poses, -1);
}

TEST_F(Swapping, AnotherMapDoesNotWaitForTheOneThatFailed) {
  Publisher camera = OpenPublisher();
  ServeOptions options = Options(camera.endpoint());
  options.retry_wait_s = options.max_retry_wait_s = 3600;
  RunningServe serve(options, source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  source_.next_build = -1;
  EXPECT_TRUE(Eventually([&] {
    SleepMs(5);
    return source_.num_failed == 1;
  }));
  for (int i = 0; i < 20; ++i) AnswersUntilBuild(camera, poses, SampleBundle().build);
  EXPECT_EQ(source_.num_failed, 1) << "it waits";
  source_.next_build = 44;
  AnswersUntilBuild(camera, poses, 44);
}

}  // namespace
}  // namespace panofix
