// The publishing side: an XPUB socket, so that subscribers can be waited for.

#include "common/base/log.h"
#include "runtime/service/log_throttle.h"
#include "runtime/service/socket_monitor.h"
#include "runtime/service/socket_support.h"
#include "runtime/service/sockets.h"
#include "runtime/service/zap_gate.h"

namespace panofix {

struct Publisher::Impl {
  zmq::context_t context;  // outlives the sockets
  std::optional<ZapGate> gate;
  zmq::socket_t socket;
  std::optional<SocketMonitor> monitor;
  std::string endpoint;
  std::int64_t num_without_key = 0;
  LogThrottle come_log, gone_log, handshake_log;

  void ReadEvents();
};

void Publisher::Impl::ReadEvents() {
  for (const SocketEvent& event : monitor->Take()) {
    switch (event.number) {
      case ZMQ_EVENT_HANDSHAKE_FAILED_NO_DETAIL:
      case ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL:
        if (gate) ++num_without_key;
        handshake_log.Warn(endpoint + (gate ? ": somebody without a key was turned away"
                                            : ": somebody does not speak ZeroMQ, or with keys"));
        break;
      default:
        break;
    }
  }
}

Publisher::Publisher(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Publisher::Publisher(Publisher&&) noexcept = default;
Publisher& Publisher::operator=(Publisher&&) noexcept = default;
Publisher::~Publisher() = default;

Result<Publisher> Publisher::Bind(const std::string& endpoint, const PublisherOptions& options) {
  if (Status status = CheckEndpoint("endpoint", endpoint); !status.ok()) return status;
  const auto address = AddressToBind(endpoint, options.security);
  if (!address.ok()) return address.status();
  // Subscribers send topic prefixes and nothing else.
  constexpr std::int64_t kMaxSubscriptionBytes = 1024;
  try {
    auto impl = std::make_unique<Impl>();
    impl->socket = zmq::socket_t(impl->context, zmq::socket_type::xpub);
    impl->socket.set(zmq::sockopt::sndhwm, options.send_queue_messages);
    impl->socket.set(zmq::sockopt::linger, options.linger_ms);
    impl->socket.set(zmq::sockopt::maxmsgsize, kMaxSubscriptionBytes);
    impl->socket.set(zmq::sockopt::xpub_verboser, true);  // each one's coming and going
    socket_support::SetHeartbeat(impl->socket);
    if (options.security.own) impl->gate.emplace(impl->context, options.security.client_keys);
    socket_support::SetSecurity(impl->socket, options.security, true);
    impl->monitor.emplace(impl->context, impl->socket, "publisher");
    impl->socket.bind(*address);
    impl->endpoint = impl->socket.get(zmq::sockopt::last_endpoint);
    return Publisher(std::move(impl));
  } catch (const zmq::error_t& error) {
    return socket_support::EndpointError(endpoint, "bind", error);
  }
}

Status Publisher::Send(std::string_view topic, std::span<const std::uint8_t> payload) {
  try {
    impl_->socket.send(zmq::buffer(topic.data(), topic.size()), zmq::send_flags::sndmore);
    impl_->socket.send(zmq::buffer(payload.data(), payload.size()), zmq::send_flags::none);
  } catch (const zmq::error_t& error) {
    return {ErrorCode::kIo, impl_->endpoint + ": cannot publish: " + error.what()};
  }
  return {};
}

std::vector<std::string> Publisher::TakeSubscriptions(int timeout_ms) {
  std::vector<std::string> topics;
  try {
    impl_->ReadEvents();
    zmq::pollitem_t item{impl_->socket.handle(), 0, ZMQ_POLLIN, 0};
    zmq::poll(&item, 1, std::chrono::milliseconds(timeout_ms));
    zmq::message_t message;
    // Bounded, so that a flood of subscriptions cannot keep the caller.
    for (int i = 0; i < 1000; ++i) {
      if (!impl_->socket.recv(message, zmq::recv_flags::dontwait)) break;
      // 1 + prefix subscribes, 0 + prefix unsubscribes.
      const std::string text = message.to_string();
      if (text.empty()) continue;
      if (text[0] == 1) {
        topics.push_back(text.substr(1));
        impl_->come_log.Write(LogLevel::kInfo, impl_->endpoint + ": a subscription has come");
      } else if (text[0] == 0) {
        impl_->gone_log.Write(LogLevel::kInfo, impl_->endpoint + ": a subscription has ended");
      }
    }
  } catch (const zmq::error_t&) {
    // A signal; the caller asks again.
  }
  return topics;
}

std::int64_t Publisher::num_denied() const {
  return impl_->num_without_key + (impl_->gate ? impl_->gate->num_denied() : 0);
}
const std::string& Publisher::endpoint() const { return impl_->endpoint; }

}  // namespace panofix
