// A newer map while frames come in, with engines that need none.
#include <gtest/gtest.h>

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

TEST_F(Swapping, AMapThatDoesNotOpenChangesNothing) {
  Publisher camera = OpenPublisher();
  RunningServe serve(Options(camera.endpoint()), source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  source_.next_build = -1;
  EXPECT_TRUE(Eventually([&] {
    SleepMs(5);
    return source_.next_build == 0;
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
    return source_.next_build == 0;
  }));
  EXPECT_TRUE(serve.Stop().ok());
}

}  // namespace
}  // namespace panofix
