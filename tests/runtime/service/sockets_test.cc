// Sockets and the frame receiver over real connections.

#include "runtime/service/sockets.h"

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <zmq.hpp>

#include "runtime/service/frame_receiver.h"
#include "tests/runtime/service/service_support.h"

namespace panofix {
namespace {

using namespace service_test;

class Sockets : public ServiceTest {};
class FrameReceiving : public ServiceTest {};

const std::vector<std::uint8_t> kPayload{1, 2, 3};

void ExpectRoundTrip(const std::string& bind) {
  Publisher publisher = OpenPublisher(bind);
  Subscriber subscriber = OpenSubscriber(publisher.endpoint(), {kPoseTopic});
  std::optional<WireMessage> message;
  EXPECT_TRUE(Eventually([&] {
    EXPECT_TRUE(publisher.Send(kPoseTopic, kPayload).ok());
    return (message = ReceiveOne(subscriber, 20)).has_value();
  }));
  ASSERT_TRUE(message.has_value());
  EXPECT_EQ(message->topic, kPoseTopic);
  EXPECT_EQ(std::vector<std::uint8_t>(message->payload.bytes.begin(), message->payload.bytes.end()),
            kPayload);
}

TEST_F(Sockets, RoundTripOverTcp) { ExpectRoundTrip(kAnyPort); }

TEST_F(Sockets, RoundTripOverIpc) {
  const TemporaryFolder folder;
  ExpectRoundTrip("ipc://" + (folder.path() / "poses").string());
}

TEST_F(Sockets, PublisherTellsWhatSubscribersAskFor) {
  Publisher publisher = OpenPublisher();
  EXPECT_TRUE(publisher.TakeSubscriptions(0).empty());
  const Subscriber subscriber = OpenSubscriber(publisher.endpoint(), {kFrameTopic});
  std::vector<std::string> topics;
  EXPECT_TRUE(Eventually([&] { return !(topics = publisher.TakeSubscriptions(50)).empty(); }));
  EXPECT_EQ(topics, std::vector<std::string>{std::string(kFrameTopic)});
}

// Two of one topic, one after the other: each is told, whether it says so or breaks off.
TEST_F(Sockets, SubscriptionsThatComeAndEndAreTold) {
  SetLogLevel("info");
  testing::internal::CaptureStderr();
  Publisher publisher = OpenPublisher();
  const auto wait_for = [&](const std::string& line) {
    std::string log;
    const bool found = Eventually([&] {
      static_cast<void>(publisher.TakeSubscriptions(20));
      log += testing::internal::GetCapturedStderr();
      testing::internal::CaptureStderr();
      return log.find(publisher.endpoint() + line) != std::string::npos;
    });
    EXPECT_TRUE(found) << line << " is not in: " << log;
  };
  auto first = std::make_optional(OpenSubscriber(publisher.endpoint(), {kFrameTopic}));
  wait_for(": a subscription has come");
  const Subscriber second = OpenSubscriber(publisher.endpoint(), {kFrameTopic});
  EXPECT_TRUE(Eventually([&] { return !publisher.TakeSubscriptions(20).empty(); }));
  first.reset();
  wait_for(": a subscription has ended");
  static_cast<void>(testing::internal::GetCapturedStderr());
  SetLogLevel("off");
}

TEST_F(Sockets, EndpointSyntax) {
  for (const char* good : {"tcp://*:5556", "tcp://127.0.0.1:0", "tcp://[::1]:9", "tcp://host:*",
                           "ipc:///tmp/frames", "ipc://relative"}) {
    EXPECT_TRUE(CheckEndpoint("poses", good).ok()) << good;
  }
  for (const char* bad : {"", "5556", "tcp://", "tcp://host", "tcp://host:", "tcp://:5", "ipc://",
                          "tcp://host:70000", "tcp://host:12a", "udp://host:5", "inproc://x"}) {
    const Status status = CheckEndpoint("poses", bad);
    EXPECT_EQ(status.code(), ErrorCode::kInvalidArgument) << bad;
    EXPECT_NE(status.message().find("poses '" + std::string(bad) + "'"), std::string::npos);
  }
}

TEST_F(Sockets, TakenAddressIsNamedWithTheMend) {
  const Publisher first = OpenPublisher();
  const auto second = Publisher::Bind(first.endpoint(), {});
  ASSERT_FALSE(second.ok());
  EXPECT_EQ(second.status().code(), ErrorCode::kIo);
  EXPECT_NE(second.status().message().find(first.endpoint()), std::string::npos);
  EXPECT_NE(second.status().message().find("choose another"), std::string::npos);
}

TEST_F(Sockets, FolderOfAnIpcAddressMustExist) {
  const TemporaryFolder folder;
  const auto publisher = Publisher::Bind("ipc://" + (folder.path() / "none/x").string(), {});
  ASSERT_FALSE(publisher.ok());
  EXPECT_NE(publisher.status().message().find("make the folder"), std::string::npos);
}

// A peer that speaks ZeroMQ, but not our messages.
TEST_F(Sockets, OtherNumbersOfPartsAreCountedAndSurvived) {
  zmq::context_t context;
  zmq::socket_t peer(context, zmq::socket_type::xpub);
  peer.set(zmq::sockopt::linger, 0);
  peer.bind(kAnyPort);
  Subscriber subscriber =
      OpenSubscriber(peer.get(zmq::sockopt::last_endpoint), {kFrameTopic, kCameraTopic});
  zmq::message_t subscription;
  peer.set(zmq::sockopt::rcvtimeo, static_cast<int>(1000 * kPatience.count()));
  for (int i = 0; i < 2; ++i) ASSERT_TRUE(peer.recv(subscription).has_value());
  const auto send = [&peer](const std::vector<std::string>& parts) {
    for (std::size_t i = 0; i < parts.size(); ++i) {
      peer.send(zmq::buffer(parts[i]),
                i + 1 < parts.size() ? zmq::send_flags::sndmore : zmq::send_flags::none);
    }
  };
  const std::string topic(kFrameTopic);
  send({topic});
  send({topic, "a", "b"});
  send({topic, "a", "b", "c", "d"});
  send({topic + "0", "a longer topic passes the prefix filter"});
  send({topic, ""});
  send({topic, "good"});
  std::vector<std::string> payloads;
  EXPECT_TRUE(Eventually([&] {
    if (const auto message = ReceiveOne(subscriber)) {
      EXPECT_EQ(message->topic, topic);
      payloads.emplace_back(message->payload.bytes.begin(), message->payload.bytes.end());
    }
    return payloads.size() == 2;
  }));
  EXPECT_EQ(payloads, (std::vector<std::string>{"", "good"}));
  EXPECT_EQ(subscriber.counters().malformed, 3);
  EXPECT_EQ(subscriber.counters().wrong_topic, 1);
}

std::unique_ptr<FrameReceiver> OpenReceiver(const std::string& endpoint,
                                            std::size_t max_message_bytes = 1 << 20) {
  FrameReceiverOptions options;
  options.endpoint = endpoint;
  options.max_message_bytes = max_message_bytes;
  options.quiet_warning_s = 0.05;
  return ValueOrThrow(FrameReceiver::Open(options));
}

// Sends one-byte frames until one arrives that holds `value`.
bool DeliverUntil(Publisher& publisher, FrameReceiver& receiver, std::uint8_t value) {
  const std::vector<std::uint8_t> payload{value};
  return Eventually([&] {
    EXPECT_TRUE(publisher.Send(kFrameTopic, payload).ok());
    const auto frame = receiver.TakeFrame(std::chrono::milliseconds(20));
    return frame && frame->payload.bytes[0] == value;
  });
}

TEST_F(FrameReceiving, TheNewestFrameWins) {
  Publisher publisher = OpenPublisher();
  const auto receiver = OpenReceiver(publisher.endpoint());
  ASSERT_TRUE(DeliverUntil(publisher, *receiver, 0));
  const FeedCounts before = receiver->counters();
  // Paced, so that no queue on the way overflows: what is tested is the mailbox.
  for (std::uint8_t i = 1; i <= 50; ++i) {
    ASSERT_TRUE(publisher.Send(kFrameTopic, std::vector<std::uint8_t>{i}).ok());
    EXPECT_TRUE(Eventually([&] {
      SleepMs(1);
      return receiver->counters().frames >= before.frames + i;
    }));
  }
  const auto frame = receiver->TakeFrame(std::chrono::milliseconds(0));
  ASSERT_TRUE(frame.has_value());
  EXPECT_EQ(frame->payload.bytes[0], 50);
  EXPECT_FALSE(receiver->TakeFrame(std::chrono::milliseconds(0)).has_value());
  EXPECT_GE(receiver->counters().replaced - before.replaced, 49);
}

TEST_F(FrameReceiving, CalibrationHasAMailboxOfItsOwn) {
  Publisher publisher = OpenPublisher();
  const auto receiver = OpenReceiver(publisher.endpoint());
  EXPECT_TRUE(Eventually([&] {
    EXPECT_TRUE(publisher.Send(kCameraTopic, kPayload).ok());
    SleepMs(10);
    return !receiver->TakeCalibrations().empty();
  }));
  // Several that came together are all there, up to a bound, the newest last.
  const std::int64_t before = receiver->counters().calibrations;
  for (std::uint8_t i = 1; i <= 20; ++i) {
    ASSERT_TRUE(publisher.Send(kCameraTopic, std::vector<std::uint8_t>{i}).ok());
    EXPECT_TRUE(Eventually([&] { return receiver->counters().calibrations >= before + i; }));
  }
  const std::vector<WireBytes> calibrations = receiver->TakeCalibrations();
  ASSERT_EQ(calibrations.size(), 8U);
  EXPECT_EQ(calibrations.front().bytes[0], 13);
  EXPECT_EQ(calibrations.back().bytes[0], 20);
  EXPECT_TRUE(DeliverUntil(publisher, *receiver, 9));
}

TEST_F(FrameReceiving, PublisherThatDiesAndReturnsIsPickedUp) {
  const TemporaryFolder folder;
  const std::string endpoint = "ipc://" + (folder.path() / "frames").string();
  auto publisher = std::make_unique<Publisher>(OpenPublisher(endpoint));
  const auto receiver = OpenReceiver(endpoint);
  EXPECT_TRUE(DeliverUntil(*publisher, *receiver, 1));
  publisher.reset();
  EXPECT_TRUE(Eventually([&] {
    SleepMs(5);
    return receiver->counters().disconnects == 1;
  }));
  publisher = std::make_unique<Publisher>(OpenPublisher(endpoint));
  EXPECT_TRUE(DeliverUntil(*publisher, *receiver, 2));
}

TEST_F(FrameReceiving, FrameAboveTheLimitEndsTheConnectionOnly) {
  Publisher publisher = OpenPublisher();
  const auto receiver = OpenReceiver(publisher.endpoint(), 1 << 20);
  ASSERT_TRUE(DeliverUntil(publisher, *receiver, 1));
  const std::vector<std::uint8_t> giant((1 << 20) + 1, 7);
  ASSERT_TRUE(publisher.Send(kFrameTopic, giant).ok());
  EXPECT_TRUE(Eventually([&] {
    SleepMs(5);
    return receiver->counters().disconnects > 0;
  }));
  EXPECT_TRUE(DeliverUntil(publisher, *receiver, 2));
}

std::size_t CountIn(const std::string& text, const std::string& part) {
  std::size_t count = 0;
  for (std::size_t at = 0; (at = text.find(part, at)) != std::string::npos; ++at) ++count;
  return count;
}

TEST_F(FrameReceiving, AnOutageIsToldAndItsEndToo) {
  const TemporaryFolder folder;
  const std::string endpoint = "ipc://" + (folder.path() / "frames").string();
  SetLogLevel("info");
  testing::internal::CaptureStderr();
  auto publisher = std::make_unique<Publisher>(OpenPublisher(endpoint));
  const auto receiver = OpenReceiver(endpoint);
  EXPECT_TRUE(DeliverUntil(*publisher, *receiver, 1));
  publisher.reset();
  EXPECT_TRUE(Eventually([&] {
    SleepMs(5);
    return receiver->counters().disconnects == 1;
  }));
  publisher = std::make_unique<Publisher>(OpenPublisher(endpoint));
  EXPECT_TRUE(DeliverUntil(*publisher, *receiver, 2));
  const std::string log = testing::internal::GetCapturedStderr();
  SetLogLevel("off");
  EXPECT_EQ(CountIn(log, "frames: connected\n"), 1U) << log;
  EXPECT_EQ(CountIn(log, "frames: disconnected"), 1U) << log;
  EXPECT_EQ(CountIn(log, "frames: connected again\n"), 1U) << log;
}

// ZeroMQ itself never tries again an address whose peer wanted another security mechanism.
TEST_F(FrameReceiving, CameraInThePlaceOfAForeignServerIsPickedUp) {
  const TemporaryFolder folder;
  const std::string path = (folder.path() / "frames").string();
  const int server = socket(AF_UNIX, SOCK_STREAM, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  ASSERT_LT(path.size(), sizeof(address.sun_path));
  std::copy(path.begin(), path.end(), address.sun_path);
  ASSERT_EQ(bind(server, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
  ASSERT_EQ(listen(server, 8), 0);
  const auto receiver = OpenReceiver("ipc://" + path);
  const int client = accept(server, nullptr, nullptr);
  // ZMTP 3.0 greeting: signature, version, mechanism, padding.
  std::string greeting("\xff\0\0\0\0\0\0\0\0\x7f\x03\0CURVE", 17);
  greeting.resize(64, '\0');
  ASSERT_EQ(write(client, greeting.data(), greeting.size()), 64);
  char byte = 0;
  while (read(client, &byte, 1) > 0) continue;  // until the receiver hangs up
  close(client);
  close(server);
  std::filesystem::remove(path);
  Publisher camera = OpenPublisher("ipc://" + path);
  EXPECT_TRUE(DeliverUntil(camera, *receiver, 1));
}

TEST_F(FrameReceiving, ReceiverThatBindsTakesACameraThatConnects) {
  const auto receiver = OpenReceiver(kAnyPort);
  zmq::context_t context;
  zmq::socket_t camera(context, zmq::socket_type::pub);
  camera.set(zmq::sockopt::linger, 0);
  camera.connect(receiver->endpoint());
  EXPECT_TRUE(Eventually([&] {
    camera.send(zmq::buffer(std::string(kFrameTopic)), zmq::send_flags::sndmore);
    camera.send(zmq::buffer(std::string("frame")), zmq::send_flags::none);
    return receiver->TakeFrame(std::chrono::milliseconds(20)).has_value();
  }));
}

TEST_F(FrameReceiving, WithoutAPublisherItWaits) {
  const auto receiver = OpenReceiver("tcp://127.0.0.1:9");
  EXPECT_FALSE(receiver->TakeFrame(std::chrono::milliseconds(150)).has_value());
  EXPECT_TRUE(receiver->status().ok());
}

}  // namespace
}  // namespace panofix
