// The subscribing side: a SUB socket and the monitor that tells of its connections.

#include <chrono>
#include <utility>

#include "common/base/log.h"
#include "runtime/service/log_throttle.h"
#include "runtime/service/socket_monitor.h"
#include "runtime/service/socket_support.h"
#include "runtime/service/sockets.h"
#include "runtime/service/zap_gate.h"

namespace panofix {
namespace {

using Clock = std::chrono::steady_clock;
constexpr int kReconnectInterval_ms = 100, kMaxReconnectInterval_ms = 1000;
constexpr std::chrono::milliseconds kReopenDelay(200);

}  // namespace

struct Subscriber::Impl {
  zmq::context_t context;  // outlives the sockets
  std::optional<ZapGate> gate;
  zmq::socket_t socket;
  std::optional<SocketMonitor> monitor;
  std::string endpoint;
  bool binds = false;
  SubscriberOptions options;
  SubscriberCounters counters;
  int num_opened = 0;
  std::optional<Clock::time_point> reopen_at;
  bool was_connected = false;
  bool is_told_gone = false;    // by the log, and not yet that one is back
  bool is_turned_away = false;  // a disconnect will follow that the log has told of
  LogThrottle connection_log, handshake_log, malformed_log;

  void Open();
  void HandleEvent(std::uint16_t event);
  std::optional<WireMessage> ReceiveOne();
};

// Makes the socket, or makes it anew: ZeroMQ reconnects by itself after a broken connection, but
// gives an address up for good once its peer broke the protocol or sent a message above the limit.
void Subscriber::Impl::Open() {
  monitor.reset();
  reopen_at.reset();
  is_turned_away = false;
  socket = zmq::socket_t(context, zmq::socket_type::sub);
  socket.set(zmq::sockopt::linger, 0);
  // Never ZMQ_CONFLATE: with multipart messages any peer can abort the process through it.
  socket.set(zmq::sockopt::rcvhwm, options.receive_queue_messages);
  socket.set(zmq::sockopt::maxmsgsize, static_cast<std::int64_t>(options.max_message_bytes));
  socket.set(zmq::sockopt::reconnect_ivl, kReconnectInterval_ms);
  socket.set(zmq::sockopt::reconnect_ivl_max, kMaxReconnectInterval_ms);
  socket_support::SetHeartbeat(socket);
  for (const std::string_view topic : options.topics) {
    socket.set(zmq::sockopt::subscribe, zmq::buffer(topic.data(), topic.size()));
  }
  socket_support::SetSecurity(socket, options.security, binds);
  // A name of its own: the monitor before may still be closing.
  monitor.emplace(context, socket, std::to_string(num_opened++));
  if (binds) {
    socket.bind(endpoint);
    endpoint = socket.get(zmq::sockopt::last_endpoint);
  } else {
    socket.connect(endpoint);
  }
}

void Subscriber::Impl::HandleEvent(std::uint16_t event) {
  switch (event) {
    case ZMQ_EVENT_CONNECTED:
    case ZMQ_EVENT_ACCEPTED:
      ++counters.connects;
      break;
    case ZMQ_EVENT_HANDSHAKE_SUCCEEDED:
      // The first, and one after each line that one has gone: a peer that comes and goes would fill
      // the log.
      if (!was_connected) LogInfo(endpoint + ": connected");
      if (is_told_gone) LogInfo(endpoint + ": connected again");
      was_connected = true, is_told_gone = false;
      break;
    case ZMQ_EVENT_DISCONNECTED:
      ++counters.disconnects;
      if (!binds) reopen_at = Clock::now() + kReopenDelay;
      if (std::exchange(is_turned_away, false)) break;
      is_told_gone |= connection_log.Warn(
          Format("%s: disconnected: the publisher ended, or sent a message above "
                 "%zu bytes; waiting for it",
                 endpoint.c_str(), options.max_message_bytes));
      break;
    case ZMQ_EVENT_HANDSHAKE_FAILED_AUTH:
      is_turned_away = true;
      // Bound, the gate has counted it.
      if (!binds) ++counters.denied;
      handshake_log.Warn(endpoint + (binds ? ": a publisher was turned away for its key"
                                           : ": turned away; is our key listed there?"));
      break;
    default:
      is_turned_away = true;
      if (options.security.own) ++counters.denied;
      if (!binds) reopen_at = Clock::now() + kReopenDelay;
      handshake_log.Warn(endpoint +
                         (options.security.own
                              ? ": the other side has another key, or none; check the keys"
                              : ": the other side does not speak ZeroMQ, or wants keys; check the "
                                "port and --secret-key"));
  }
}

// Reads one whole multipart message, whatever it is; nullopt where it is none of ours.
std::optional<WireMessage> Subscriber::Impl::ReceiveOne() {
  zmq::message_t topic;
  auto payload = std::make_shared<zmq::message_t>();
  if (!socket.recv(topic, zmq::recv_flags::dontwait)) return std::nullopt;
  int num_parts = 1;
  bool more = topic.more();
  zmq::message_t surplus;
  while (more) {
    zmq::message_t& part = num_parts == 1 ? *payload : surplus;
    // Of a message that has too many nothing is kept while the others are read.
    if (num_parts == 2) payload->rebuild();
    if (!socket.recv(part, zmq::recv_flags::dontwait)) break;
    more = part.more();
    ++num_parts;
  }
  if (num_parts != 2) {
    ++counters.malformed;
    malformed_log.Warn(
        Format("%s: a message of %d parts; send [topic, payload]", endpoint.c_str(), num_parts));
    return std::nullopt;
  }
  WireMessage message{topic.to_string(), {}};
  if (std::find(options.topics.begin(), options.topics.end(), message.topic) ==
      options.topics.end()) {
    ++counters.wrong_topic;
    return std::nullopt;
  }
  message.payload.bytes = {payload->data<std::uint8_t>(), payload->size()};
  message.payload.owner = std::move(payload);
  return message;
}

Subscriber::Subscriber(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Subscriber::Subscriber(Subscriber&&) noexcept = default;
Subscriber& Subscriber::operator=(Subscriber&&) noexcept = default;
Subscriber::~Subscriber() = default;

Result<Subscriber> Subscriber::Open(const std::string& endpoint, const SubscriberOptions& options) {
  if (Status status = CheckEndpoint("endpoint", endpoint); !status.ok()) return status;
  auto impl = std::make_unique<Impl>();
  impl->endpoint = endpoint;
  impl->binds = endpoint.find('*') != std::string::npos;
  impl->options = options;
  try {
    if (impl->binds) {
      const auto address = AddressToBind(endpoint, options.security);
      if (!address.ok()) return address.status();
      impl->endpoint = *address;
      if (options.security.own) impl->gate.emplace(impl->context, options.security.client_keys);
    }
    impl->Open();
  } catch (const zmq::error_t& error) {
    return socket_support::EndpointError(endpoint, impl->binds ? "bind" : "connect", error);
  }
  return Subscriber(std::move(impl));
}

Result<std::optional<WireMessage>> Subscriber::Receive(int timeout_ms) {
  try {
    zmq::pollitem_t items[] = {{impl_->socket.handle(), 0, ZMQ_POLLIN, 0},
                               {impl_->monitor->handle(), 0, ZMQ_POLLIN, 0}};
    zmq::poll(items, 2, std::chrono::milliseconds(timeout_ms));
    if (items[1].revents != 0) {
      for (const SocketEvent& event : impl_->monitor->Take()) impl_->HandleEvent(event.number);
    }
    if (items[0].revents != 0) return impl_->ReceiveOne();
    // Only now: what the old socket has received is not lost.
    if (impl_->reopen_at && Clock::now() >= *impl_->reopen_at) impl_->Open();
    return std::optional<WireMessage>();
  } catch (const zmq::error_t& error) {
    if (error.num() == EINTR) return std::optional<WireMessage>();
    return Status(ErrorCode::kIo, impl_->endpoint + ": cannot receive: " + error.what());
  } catch (const std::bad_alloc&) {
    return Status(ErrorCode::kIo, impl_->endpoint + ": out of memory; lower the message limit");
  }
}

SubscriberCounters Subscriber::counters() const {
  SubscriberCounters counters = impl_->counters;
  if (impl_->gate) counters.denied += impl_->gate->num_denied();
  return counters;
}
const std::string& Subscriber::endpoint() const { return impl_->endpoint; }

}  // namespace panofix
