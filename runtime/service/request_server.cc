#include "runtime/service/request_server.h"

#include <atomic>
#include <optional>
#include <thread>

#include "common/base/log.h"
#include "runtime/service/log_throttle.h"
#include "runtime/service/messages.h"
#include "runtime/service/rate_limit.h"
#include "runtime/service/socket_support.h"
#include "runtime/service/sockets.h"
#include "runtime/service/topics.h"
#include "runtime/service/zap_gate.h"

namespace panofix {
namespace {

struct Reply {
  std::string_view topic;
  std::vector<std::uint8_t> payload;
};

Reply ErrorReply(const std::string& text) { return {kErrorTopic, {text.begin(), text.end()}}; }

}  // namespace

struct RequestServer::Impl {
  ~Impl() {
    stop = true;
    if (thread.joinable()) thread.join();
  }
  void Run();
  // The parts of a request; none where they are more than two.
  std::vector<std::shared_ptr<zmq::message_t>> Receive();
  Reply AnswerOrSayWhyNot(std::vector<std::shared_ptr<zmq::message_t>> parts);
  Reply Answer(std::vector<std::shared_ptr<zmq::message_t>> parts);

  explicit Impl(const RequestServerOptions& server_options)
      : options(server_options), rate_limit(server_options.max_rate_hz) {}

  const RequestServerOptions options;
  RateLimit rate_limit;
  zmq::context_t context;  // outlives the sockets
  std::optional<ZapGate> gate;
  zmq::socket_t socket;
  std::string endpoint;
  std::function<std::unique_ptr<FrameEngine>()> take_newer;
  ServiceMonitor* monitor = nullptr;
  std::unique_ptr<FrameEngine> engine;
  LogThrottle request_log;
  std::atomic<bool> stop{false};
  std::thread thread;
};

std::vector<std::shared_ptr<zmq::message_t>> RequestServer::Impl::Receive() {
  constexpr std::size_t kNumParts = 2;
  std::vector<std::shared_ptr<zmq::message_t>> parts;
  bool more = true, is_surplus = false;
  while (more) {
    auto part = std::make_shared<zmq::message_t>();
    if (!socket.recv(*part)) break;
    more = part->more();
    is_surplus = is_surplus || parts.size() == kNumParts;
    // Of a message that has too many nothing is kept while the others are read.
    if (is_surplus) {
      parts.clear();
    } else {
      parts.push_back(std::move(part));
    }
  }
  return parts;
}

// One image that cannot be answered, too large for the memory, say, does not end the others.
Reply RequestServer::Impl::AnswerOrSayWhyNot(std::vector<std::shared_ptr<zmq::message_t>> parts) {
  if (!rate_limit.MayPass()) {
    monitor->Count(&MonitorSnapshot::num_requests_refused);
    return ErrorReply(
        Format("more than %g requests a second; ask again later, or have the service "
               "started with a larger --max-rate-hz",
               options.max_rate_hz));
  }
  try {
    return Answer(std::move(parts));
  } catch (const std::exception& error) {
    request_log.Warn(endpoint + ": a request could not be answered: " + error.what());
    return ErrorReply(std::string("cannot be answered: ") + error.what());
  }
}

Reply RequestServer::Impl::Answer(std::vector<std::shared_ptr<zmq::message_t>> parts) {
  if (parts.size() != 2 || parts[0]->to_string_view() != kFrameTopic) {
    return ErrorReply("send two parts: " + std::string(kFrameTopic) + " and a frame");
  }
  const auto start = std::chrono::steady_clock::now();
  WireBytes payload;
  payload.bytes = {parts[1]->data<std::uint8_t>(), parts[1]->size()};
  payload.owner = std::move(parts[1]);
  const auto frame = UnpackFrame(payload);
  if (!frame.ok()) return ErrorReply(frame.status().message());
  const auto gray = ConvertFrame(*frame, FrameLimitsFor(engine->camera()));
  const auto since_start_ms = [start] {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
        .count();
  };
  const double decode_ms = since_start_ms();
  const TimeIsUp time_is_up = [&] {
    return stop || (options.deadline_ms > 0 && since_start_ms() >= options.deadline_ms);
  };
  engine->Forget();
  FrameResult result = gray.ok() ? engine->Localize(frame->timestamp_ns, *gray, time_is_up)
                                 : engine->Undecodable(frame->timestamp_ns);
  result.timestamp_ns = frame->timestamp_ns;
  return {kPoseTopic, PackResult(result, engine->bundle(), decode_ms)};
}

void RequestServer::Impl::Run() {
  constexpr std::chrono::milliseconds kPoll(50);  // bounds the time to a stop
  while (!stop) {
    try {
      // Also while nobody asks: the old one keeps its map in memory.
      if (auto newer = take_newer()) engine = std::move(newer);
      zmq::pollitem_t item{socket.handle(), 0, ZMQ_POLLIN, 0};
      if (zmq::poll(&item, 1, kPoll) == 0) continue;
      const Reply reply = AnswerOrSayWhyNot(Receive());
      monitor->Count(&MonitorSnapshot::num_requests);
      socket.send(zmq::buffer(reply.topic), zmq::send_flags::sndmore);
      socket.send(zmq::buffer(reply.payload), zmq::send_flags::none);
    } catch (const zmq::error_t& error) {
      if (error.num() == EINTR) continue;
      Log(LogLevel::kError, endpoint + ": no more requests are answered: " + error.what());
      return;
    } catch (const std::exception& error) {
      // Of the request itself: AnswerOrSayWhyNot. This one's sender gets no answer.
      Log(LogLevel::kError, endpoint + ": a request is lost: " + error.what());
    }
  }
}

RequestServer::RequestServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
RequestServer::~RequestServer() = default;
const std::string& RequestServer::endpoint() const { return impl_->endpoint; }

Result<std::unique_ptr<RequestServer>> RequestServer::Start(
    const RequestServerOptions& options, std::function<std::unique_ptr<FrameEngine>()> take_newer,
    ServiceMonitor& monitor) {
  if (Status status = CheckEndpoint("requests", options.endpoint); !status.ok()) return status;
  const auto address = AddressToBind(options.endpoint, options.security);
  if (!address.ok()) return address.status();
  auto impl = std::make_unique<Impl>(options);
  impl->take_newer = std::move(take_newer);
  impl->monitor = &monitor;
  try {
    impl->socket = zmq::socket_t(impl->context, zmq::socket_type::rep);
    if (options.security.own) impl->gate.emplace(impl->context, options.security.client_keys);
    impl->socket.set(zmq::sockopt::linger, 0);
    impl->socket.set(zmq::sockopt::maxmsgsize,
                     static_cast<std::int64_t>(options.max_message_bytes));
    impl->socket.set(zmq::sockopt::rcvhwm, 2);  // a peer that does not wait for answers waits
    socket_support::SetHeartbeat(impl->socket);
    socket_support::SetSecurity(impl->socket, options.security, true);
    impl->socket.bind(*address);
    impl->endpoint = impl->socket.get(zmq::sockopt::last_endpoint);
  } catch (const zmq::error_t& error) {
    return socket_support::EndpointError(options.endpoint, "bind", error);
  }
  impl->thread = std::thread([raw = impl.get()] { raw->Run(); });
  return std::unique_ptr<RequestServer>(new RequestServer(std::move(impl)));
}

}  // namespace panofix
