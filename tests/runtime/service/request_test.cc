// Single images on request, over real sockets.
#include <gtest/gtest.h>

#include <zmq.hpp>

#include "tests/runtime/service/service_support.h"

namespace panofix {
namespace {

using namespace service_test;

using Parts = std::vector<std::string>;

class Requesting : public ServiceTest {
 protected:
  void Start(bool may_open = true) {
    source_.may_open = may_open;
    Start(ServeOptionsFor("tcp://127.0.0.1:9"));
  }
  void Start(ServeOptions options) {
    options.requests = kAnyPort;
    options.update_interval_s = 0.01;
    options.on_requests = [this](const std::string& endpoint) { endpoint_ = endpoint; };
    serve_ = std::make_unique<RunningServe>(options, source_);
  }
  // The reply's parts; none where there is no reply.
  Parts Ask(const Parts& request) {
    zmq::socket_t socket(context_, zmq::socket_type::req);
    socket.set(zmq::sockopt::linger, 0);
    socket.set(zmq::sockopt::rcvtimeo, static_cast<int>(1000 * kPatience.count()));
    socket.connect(endpoint_);
    for (std::size_t i = 0; i < request.size(); ++i) {
      socket.send(zmq::buffer(request[i]),
                  i + 1 < request.size() ? zmq::send_flags::sndmore : zmq::send_flags::none);
    }
    Parts reply;
    zmq::message_t part;
    do {
      if (!socket.recv(part)) break;
      reply.push_back(part.to_string());
    } while (part.more());
    return reply;
  }
  Parts AskFrame(const std::vector<std::uint8_t>& payload) {
    return Ask({std::string(kFrameTopic), std::string(payload.begin(), payload.end())});
  }
  static ReceivedResult ResultIn(const Parts& reply) {
    EXPECT_EQ(reply.at(0), kPoseTopic) << reply.at(1);
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(reply.at(1).data());
    return ValueOrThrow(UnpackResult(WireBytes::Copy({bytes, reply.at(1).size()})));
  }

  SlowSource source_;
  std::string endpoint_;
  std::unique_ptr<RunningServe> serve_;
  zmq::context_t context_;
};

TEST_F(Requesting, AnImageIsAnsweredWithItsPose) {
  Start();
  for (std::int64_t time_ns : {50, 40, 40}) {  // times need not advance
    const ReceivedResult result = ResultIn(AskFrame(PackFrame(time_ns, SampleJpeg())));
    EXPECT_EQ(result.row.timestamp_ns, time_ns);
    EXPECT_EQ(result.row.status, FixStatus::kFix);
  }
  EXPECT_EQ(source_.num_forgotten, 3) << "nothing may be remembered between requests";
  EXPECT_EQ(source_.opened().size(), 1U) << "the map is open once, whoever asks";
  EXPECT_EQ(source_.num_shared, 1) << "an engine of its own";
}

TEST_F(Requesting, WhatIsNoFrameIsAnsweredWithALine) {
  Start();
  const std::string topic(kFrameTopic);
  for (const Parts& request :
       {Parts{"hello"}, Parts{topic}, Parts{"other", "x"}, Parts{topic, "garbage"},
        Parts{topic, ""}, Parts{topic, "a", "b"}, Parts(20, "x")}) {
    const Parts reply = Ask(request);
    ASSERT_EQ(reply.size(), 2U);
    EXPECT_EQ(reply[0], kErrorTopic);
    EXPECT_FALSE(reply[1].empty());
  }
  // It goes on.
  ResultIn(AskFrame(PackFrame(1, SampleJpeg())));
}

TEST_F(Requesting, AnImageThatDoesNotDecodeIsNoFix) {
  Start();
  auto jpeg = SampleJpeg();
  jpeg.resize(jpeg.size() / 2);
  EXPECT_EQ(ResultIn(AskFrame(PackFrame(7, jpeg))).row.reason, "frame_undecodable");
}

TEST_F(Requesting, WhileTheMapIsOpenedTheReplySaysSo) {
  Start(false);
  const ReceivedResult early = ResultIn(AskFrame(PackFrame(1, SampleJpeg())));
  EXPECT_EQ(early.row.reason, "map_loading");
  source_.may_open = true;
  EXPECT_TRUE(Eventually([&] {
    return ResultIn(AskFrame(PackFrame(2, SampleJpeg()))).row.status == FixStatus::kFix;
  }));
}

TEST_F(Requesting, AnImageThatTakesTooMuchMemoryDoesNotEndTheService) {
  Start();
  source_.is_memory_out = true;
  const Parts reply = AskFrame(PackFrame(1, SampleJpeg()));
  ASSERT_EQ(reply.size(), 2U);
  EXPECT_EQ(reply[0], kErrorTopic);
  source_.is_memory_out = false;
  ResultIn(AskFrame(PackFrame(2, SampleJpeg())));
}

TEST_F(Requesting, TimeThatIsUpIsAnsweredAsSuch) {
  source_.may_open = true;
  ServeOptions options = ServeOptionsFor("tcp://127.0.0.1:9");
  options.deadline_ms = 30;
  Start(options);
  source_.work_ms = 300'000;  // longer than this test may take
  const ReceivedResult late = ResultIn(AskFrame(PackFrame(3, SampleJpeg())));
  EXPECT_EQ(late.row.status, FixStatus::kNoFix);
  EXPECT_EQ(late.row.reason, "deadline");
  source_.work_ms = 0;
  EXPECT_EQ(ResultIn(AskFrame(PackFrame(4, SampleJpeg()))).row.status, FixStatus::kFix);
}

TEST_F(Requesting, WhoAsksTooOftenIsToldAndMayAskAgain) {
  source_.may_open = true;
  ServeOptions options = ServeOptionsFor("tcp://127.0.0.1:9");
  options.max_rate_hz = 0.5;
  Start(options);
  ResultIn(AskFrame(PackFrame(1, SampleJpeg())));
  const Parts reply = AskFrame(PackFrame(2, SampleJpeg()));
  ASSERT_EQ(reply.size(), 2U);
  EXPECT_EQ(reply[0], kErrorTopic);
  EXPECT_NE(reply[1].find("--max-rate-hz"), std::string::npos) << reply[1];
  EXPECT_EQ(source_.num_localized, 1);
  EXPECT_TRUE(Eventually([&] {
    SleepMs(100);
    return AskFrame(PackFrame(3, SampleJpeg())).at(0) == kPoseTopic;
  }));
}

TEST_F(Requesting, StopsWhileAClientWaits) {
  Start();
  source_.work_ms = 300'000;  // longer than this test may take
  std::thread client([&] {
    try {
      static_cast<void>(AskFrame(PackFrame(1, SampleJpeg())));
    } catch (const zmq::error_t&) {
      // The context has ended; there was no answer.
    }
  });
  EXPECT_TRUE(Eventually([&] {
    SleepMs(1);
    return source_.num_forgotten > 0;
  }));
  EXPECT_TRUE(serve_->Stop().ok());
  context_.shutdown();  // the client has its answer, or none will come
  client.join();
}

}  // namespace
}  // namespace panofix
