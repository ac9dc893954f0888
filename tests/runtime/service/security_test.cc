// Keys, the list of those who may connect, and what plain sockets may be bound to.
#include <gtest/gtest.h>
#include <httplib.h>
#include <sys/stat.h>

#include <fstream>
#include <zmq.hpp>

#include "runtime/service/frame_receiver.h"
#include "tests/runtime/service/service_support.h"

namespace panofix {
namespace {

using namespace service_test;

class WireKeys : public ServiceTest {};
class Secured : public ServiceTest {
 protected:
  const WireKeyPair server_ = ValueOrThrow(MakeWireKeys());
  const WireKeyPair friend_ = ValueOrThrow(MakeWireKeys());
  const WireKeyPair stranger_ = ValueOrThrow(MakeWireKeys());

  [[nodiscard]] WireSecurity ForServer() const {
    WireSecurity security;
    security.own = server_;
    security.client_keys = {friend_.public_key};
    return security;
  }
  [[nodiscard]] WireSecurity ForClient(const WireKeyPair& own) const {
    WireSecurity security;
    security.own = own;
    security.server_key = server_.public_key;
    return security;
  }
  [[nodiscard]] Publisher Bind() const {
    PublisherOptions options;
    options.linger_ms = 0;
    options.security = ForServer();
    return ValueOrThrow(Publisher::Bind(kAnyPort, options));
  }
  static Subscriber Connect(const std::string& endpoint, const WireSecurity& security) {
    SubscriberOptions options;
    options.topics = {kPoseTopic};
    options.security = security;
    return ValueOrThrow(Subscriber::Open(endpoint, options));
  }
};

const std::vector<std::uint8_t> kPayload{1, 2, 3};

TEST_F(Secured, AListedKeyIsServedAndAStrangerIsNot) {
  Publisher publisher = Bind();
  Subscriber friendly = Connect(publisher.endpoint(), ForClient(friend_));
  Subscriber strange = Connect(publisher.endpoint(), ForClient(stranger_));
  int num_received = 0;
  EXPECT_TRUE(Eventually([&] {
    EXPECT_TRUE(publisher.Send(kPoseTopic, kPayload).ok());
    static_cast<void>(publisher.TakeSubscriptions(0));
    EXPECT_FALSE(ReceiveOne(strange, 5).has_value());
    num_received += ReceiveOne(friendly, 5).has_value() ? 1 : 0;
    return num_received > 20 && publisher.num_denied() > 0 && strange.counters().denied > 0;
  })) << num_received
      << ' ' << publisher.num_denied() << ' ' << strange.counters().denied;
  EXPECT_EQ(friendly.counters().denied, 0);
}

// Nothing was connected, so nothing ended either.
TEST_F(Secured, TheLogSaysTurnedAwayAndNoMore) {
  Publisher publisher = Bind();
  SetLogLevel("info");
  testing::internal::CaptureStderr();
  Subscriber strange = Connect(publisher.endpoint(), ForClient(stranger_));
  EXPECT_TRUE(Eventually([&] {
    static_cast<void>(publisher.TakeSubscriptions(5));
    EXPECT_FALSE(ReceiveOne(strange, 5).has_value());
    return strange.counters().disconnects > 1;
  }));
  const std::string log = testing::internal::GetCapturedStderr();
  SetLogLevel("off");
  EXPECT_NE(log.find("turned away; is our key listed"), std::string::npos) << log;
  EXPECT_EQ(log.find("connected"), std::string::npos) << log;
  EXPECT_EQ(log.find("a subscription"), std::string::npos) << log;
}

TEST_F(Secured, NobodyWithoutAKeyIsServed) {
  Publisher publisher = Bind();
  Subscriber plain = Connect(publisher.endpoint(), {});
  EXPECT_TRUE(Eventually([&] {
    EXPECT_TRUE(publisher.Send(kPoseTopic, kPayload).ok());
    static_cast<void>(publisher.TakeSubscriptions(5));
    EXPECT_FALSE(ReceiveOne(plain, 5).has_value());
    return publisher.num_denied() > 0;
  }));
}

TEST_F(Secured, AnotherServersKeyIsNotBelieved) {
  Publisher publisher = Bind();
  WireSecurity security = ForClient(friend_);
  security.server_key = stranger_.public_key;  // somebody sits at the address
  Subscriber subscriber = Connect(publisher.endpoint(), security);
  for (int i = 0; i < 40; ++i) {
    ASSERT_TRUE(publisher.Send(kPoseTopic, kPayload).ok());
    ASSERT_FALSE(ReceiveOne(subscriber, 10).has_value());
  }
}

TEST_F(Secured, AFeedThatIsBoundTakesListedCamerasOnly) {
  FrameReceiverOptions options;
  options.endpoint = "tcp://127.0.0.1:*";
  options.security = ForServer();
  const auto receiver = ValueOrThrow(FrameReceiver::Open(options));
  // A camera that connects: not what Publisher does, so by the library.
  zmq::context_t context;
  const auto camera = [&](const WireKeyPair& own) {
    zmq::socket_t socket(context, zmq::socket_type::pub);
    socket.set(zmq::sockopt::linger, 0);
    socket.set(zmq::sockopt::curve_serverkey, server_.public_key);
    socket.set(zmq::sockopt::curve_publickey, own.public_key);
    socket.set(zmq::sockopt::curve_secretkey, own.secret_key);
    socket.connect(receiver->endpoint());
    return socket;
  };
  const auto send = [](zmq::socket_t& socket, const char* payload) {
    socket.send(zmq::buffer(kFrameTopic), zmq::send_flags::sndmore);
    socket.send(zmq::buffer(std::string(payload)), zmq::send_flags::none);
  };
  zmq::socket_t strange = camera(stranger_), good = camera(friend_);
  EXPECT_TRUE(Eventually([&] {
    send(strange, "bad");
    send(good, "good");
    SleepMs(5);
    return receiver->counters().frames > 10 && receiver->counters().denied > 0;
  }));
  EXPECT_EQ(receiver->TakeFrame(std::chrono::milliseconds(0))->payload.bytes.size(), 4U);
}

TEST_F(Secured, AStrangerHearsNothingOfTheServiceAndIsCounted) {
  FakeSource source;
  Publisher camera = OpenPublisher();
  ServeOptions options = ServeOptionsFor(camera.endpoint());
  options.poses_security.own = server_;
  options.poses_security.client_keys = {friend_.public_key};
  options.http_port = 0;
  std::atomic<int> port{0};
  options.on_http = [&](int bound) { port = bound; };
  RunningServe serve(options, source);
  Subscriber friendly = Connect(serve.poses(), ForClient(friend_));
  Subscriber strange = Connect(serve.poses(), ForClient(stranger_));
  bool is_counted = false;
  EXPECT_TRUE(SendUntil(
      camera, kFrameTopic, PackFrame(5, SampleJpeg()), friendly, [&](const ReceivedResult&) {
        EXPECT_FALSE(ReceiveOne(strange, 5).has_value());
        const auto page = httplib::Client("127.0.0.1", port).Get("/metrics");
        const std::string name = "panofix_peers_denied_total{socket=\"poses\"} ";
        const auto at = page ? page->body.find(name) : std::string::npos;
        is_counted = at != std::string::npos && std::stod(page->body.substr(at + name.size())) > 0;
        return is_counted;
      }));
  EXPECT_TRUE(is_counted);
}

TEST_F(Secured, TheWholeServiceRunsEncrypted) {
  FakeSource source;
  PublisherOptions camera_options;
  camera_options.security = ForServer();
  Publisher camera = ValueOrThrow(Publisher::Bind(kAnyPort, camera_options));
  ServeOptions options = ServeOptionsFor(camera.endpoint());
  options.frames_security = ForClient(friend_);
  options.poses_security.own = friend_;
  options.poses_security.client_keys = {stranger_.public_key};
  RunningServe serve(options, source);
  WireSecurity user;
  user.own = stranger_;
  user.server_key = friend_.public_key;
  Subscriber poses = Connect(serve.poses(), user);
  EXPECT_TRUE(SendUntil(camera, kFrameTopic, PackFrame(5, SampleJpeg()), poses,
                        [](const ReceivedResult& r) { return r.row.timestamp_ns == 5; }));
}

TEST_F(Secured, PlainSocketsStayOnThisMachine) {
  const auto bound = [](const std::string& endpoint, const WireSecurity& security = {}) {
    const auto address = AddressToBind(endpoint, security);
    return address.ok() ? *address : ErrorCodeName(address.status().code());
  };
  const std::string refused = ErrorCodeName(ErrorCode::kInvalidArgument);
  EXPECT_EQ(bound("tcp://*:5602"), "tcp://127.0.0.1:5602");
  EXPECT_EQ(bound("tcp://0.0.0.0:*"), "tcp://127.0.0.1:*");
  EXPECT_EQ(bound("tcp://[::1]:1"), "tcp://[::1]:1");
  EXPECT_EQ(bound("tcp://localhost:1"), "tcp://localhost:1");
  EXPECT_EQ(bound("ipc:///tmp/x"), "ipc:///tmp/x");
  EXPECT_EQ(bound("tcp://192.0.2.1:1"), refused);
  EXPECT_EQ(bound("tcp://eth0:1"), refused);
  WireSecurity open;
  open.insecure_bind = true;
  EXPECT_EQ(bound("tcp://*:5602", open), "tcp://*:5602");
  EXPECT_EQ(bound("tcp://192.0.2.1:1", open), "tcp://192.0.2.1:1");
  EXPECT_EQ(bound("tcp://*:5602", ForServer()), "tcp://*:5602");
  // The socket itself asks.
  EXPECT_EQ(Publisher::Bind("tcp://192.0.2.1:1", {}).status().code(), ErrorCode::kInvalidArgument);
  EXPECT_TRUE(
      ValueOrThrow(Publisher::Bind("tcp://*:*", {})).endpoint().starts_with("tcp://127.0.0.1:"));
}

TEST_F(WireKeys, FilesHoldWhatWasMade) {
  const TemporaryFolder folder;
  const auto name = folder.path() / "vehicle";
  const WireKeyPair keys = ValueOrThrow(MakeWireKeys());
  ASSERT_TRUE(WriteWireKeys(keys, name).ok());
  EXPECT_EQ(ValueOrThrow(ReadWireKeys(name.string() + ".key")).public_key, keys.public_key);
  EXPECT_EQ(ValueOrThrow(ReadWireKeys(name.string() + ".key")).secret_key, keys.secret_key);
  EXPECT_EQ(ValueOrThrow(ReadWirePublicKey(name.string() + ".pub")), keys.public_key);
  EXPECT_EQ(WriteWireKeys(keys, name).code(), ErrorCode::kInvalidArgument);  // never overwritten
  chmod((name.string() + ".key").c_str(), 0640);
  EXPECT_EQ(ReadWireKeys(name.string() + ".key").status().code(), ErrorCode::kUntrusted);
}

TEST_F(WireKeys, WhatIsNoKeyIsTold) {
  const TemporaryFolder folder;
  const auto path = folder.path() / "k";
  for (const std::string& text :
       {std::string(), std::string("panofix-wire-public short"), std::string(5000, 'x'),
        "panofix-wire-secret " + std::string(40, 'a'),
        "panofix-wire-public " + std::string(40, '"')}) {
    std::ofstream(path) << text;
    const auto key = ReadWirePublicKey(path);
    ASSERT_FALSE(key.ok()) << text;
    EXPECT_NE(key.status().message().find(path.string()), std::string::npos);
  }
  EXPECT_EQ(ReadWireKeys(folder.path() / "none").status().code(), ErrorCode::kNotFound);
}

TEST_F(Secured, FramesBeyondTheRateAreLeftOut) {
  Publisher camera = OpenPublisher();
  FrameReceiverOptions options;
  options.endpoint = camera.endpoint();
  options.max_rate_hz = 20;
  const auto receiver = ValueOrThrow(FrameReceiver::Open(options));
  EXPECT_TRUE(Eventually([&] {
    EXPECT_TRUE(camera.Send(kFrameTopic, kPayload).ok());
    SleepMs(1);
    return receiver->counters().frames >= 300;
  }));
  const FeedCounts counts = receiver->counters();
  EXPECT_GT(counts.rate_limited, 100);
  EXPECT_GT(counts.replaced, 0);
}

}  // namespace
}  // namespace panofix
