// A map that takes long to open: frames are answered meanwhile, and say so.
#include <gtest/gtest.h>
#include <httplib.h>

#include "tests/runtime/service/service_support.h"

namespace panofix {
namespace {

using namespace service_test;

class Loading : public ServiceTest {
 protected:
  SlowSource source_;
};

TEST_F(Loading, FramesAreAnsweredAndTheServiceIsNotReady) {
  Publisher camera = OpenPublisher();
  ServeOptions options = ServeOptionsFor(camera.endpoint());
  options.http_port = 0;
  std::atomic<int> port{0};
  options.on_http = [&](int bound) { port = bound; };
  RunningServe serve(options, source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  const auto status = [&](const char* path) {
    const auto answer = httplib::Client("127.0.0.1", port).Get(path);
    return answer ? answer->status : 0;
  };
  const auto early = SendUntil(camera, kFrameTopic, PackFrame(1, SampleJpeg()), poses,
                               [](const ReceivedResult&) { return true; });
  ASSERT_TRUE(early.has_value());
  EXPECT_EQ(early->row.reason, "map_loading");
  EXPECT_EQ(early->bundle.id, "");
  EXPECT_EQ(status("/healthz"), 200);
  EXPECT_EQ(status("/readyz"), 503);
  EXPECT_EQ(status("/api/route"), 200);
  source_.may_open = true;
  const auto late = SendUntil(camera, kFrameTopic, PackFrame(2, SampleJpeg()), poses,
                              [](const ReceivedResult& r) { return r.row.reason.empty(); });
  ASSERT_TRUE(late.has_value());
  EXPECT_EQ(late->bundle.id, SampleBundle().id);
  EXPECT_EQ(status("/readyz"), 200);
}

TEST_F(Loading, AMapThatDoesNotOpenEndsTheService) {
  RunningServe serve(ServeOptionsFor("tcp://127.0.0.1:9"), source_);
  EXPECT_FALSE(serve.ended());
  source_.is_broken = true;
  source_.may_open = true;
  EXPECT_TRUE(Eventually([&] { return serve.ended(); }));
  EXPECT_EQ(serve.Stop().code(), ErrorCode::kBadData);
}

TEST_F(Loading, ToldToStopItStops) {
  RunningServe serve(ServeOptionsFor("tcp://127.0.0.1:9"), source_);
  EXPECT_TRUE(serve.Stop().ok());
}

// The first calibration that differs has the map opened anew; no frame is answered with another.
TEST_F(Loading, ACalibrationOfTheFeedHasFramesWaitToo) {
  source_.may_open = true;
  Publisher camera = OpenPublisher();
  RunningServe serve(ServeOptionsFor(camera.endpoint()), source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  ASSERT_TRUE(SendUntil(camera, kFrameTopic, PackFrame(1, SampleJpeg()), poses,
                        [](const ReceivedResult& r) { return r.row.reason.empty(); }));
  source_.may_open = false;
  ASSERT_TRUE(
      camera.Send(kCameraTopic, PackCalibration(2, Camera::FromHorizontalFov(64, 48, 60))).ok());
  EXPECT_TRUE(SendUntil(camera, kFrameTopic, PackFrame(3, SampleJpeg()), poses,
                        [](const ReceivedResult& r) { return r.row.reason == "map_loading"; }));
  source_.may_open = true;
  EXPECT_TRUE(SendUntil(camera, kFrameTopic, PackFrame(4, SampleJpeg()), poses,
                        [](const ReceivedResult& r) { return r.row.reason.empty(); }));
  EXPECT_EQ(source_.opened().size(), 2U);
}

// A camera sends its calibration every second; frames must not wait for each.
TEST_F(Loading, ACalibrationThatDoesNotOpenIsTriedOnce) {
  source_.may_open = true;
  Publisher camera = OpenPublisher();
  RunningServe serve(ServeOptionsFor(camera.endpoint()), source_);
  Subscriber poses = OpenSubscriber(serve.poses(), {kPoseTopic});
  const auto is_answered = [](const ReceivedResult& r) { return r.row.reason.empty(); };
  ASSERT_TRUE(SendUntil(camera, kFrameTopic, PackFrame(1, SampleJpeg()), poses, is_answered));
  source_.is_broken = true;
  const auto refused = PackCalibration(2, Camera::FromHorizontalFov(64, 48, 60));
  for (int i = 0; i < 5; ++i) {
    ASSERT_TRUE(camera.Send(kCameraTopic, refused).ok());
    ASSERT_TRUE(SendUntil(camera, kFrameTopic, PackFrame(3 + i, SampleJpeg()), poses,
                          [&](const ReceivedResult& r) { return r.row.timestamp_ns == 3 + i; }));
  }
  EXPECT_EQ(source_.num_tried, 2);
  // Another one is.
  source_.is_broken = false;
  const auto good = PackCalibration(9, Camera::FromHorizontalFov(64, 48, 50));
  EXPECT_TRUE(Eventually([&] {
    EXPECT_TRUE(camera.Send(kCameraTopic, good).ok());
    SleepMs(5);
    return source_.opened().size() == 2;
  }));
}

}  // namespace
}  // namespace panofix
