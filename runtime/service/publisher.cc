// The publishing side: an XPUB socket, so that subscribers can be waited for.

#include "runtime/service/socket_support.h"
#include "runtime/service/sockets.h"

namespace panofix {

struct Publisher::Impl {
  zmq::context_t context;  // outlives the socket
  zmq::socket_t socket;
  std::string endpoint;
};

Publisher::Publisher(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Publisher::Publisher(Publisher&&) noexcept = default;
Publisher& Publisher::operator=(Publisher&&) noexcept = default;
Publisher::~Publisher() = default;

Result<Publisher> Publisher::Bind(const std::string& endpoint, const PublisherOptions& options) {
  if (Status status = CheckEndpoint("endpoint", endpoint); !status.ok()) return status;
  // Subscribers send topic prefixes and nothing else.
  constexpr std::int64_t kMaxSubscriptionBytes = 1024;
  try {
    auto impl = std::make_unique<Impl>();
    impl->socket = zmq::socket_t(impl->context, zmq::socket_type::xpub);
    impl->socket.set(zmq::sockopt::sndhwm, options.send_queue_messages);
    impl->socket.set(zmq::sockopt::linger, options.linger_ms);
    impl->socket.set(zmq::sockopt::maxmsgsize, kMaxSubscriptionBytes);
    impl->socket.set(zmq::sockopt::xpub_verbose, true);
    socket_support::SetHeartbeat(impl->socket);
    impl->socket.bind(endpoint);
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
    zmq::pollitem_t item{impl_->socket.handle(), 0, ZMQ_POLLIN, 0};
    zmq::poll(&item, 1, std::chrono::milliseconds(timeout_ms));
    zmq::message_t message;
    // Bounded, so that a flood of subscriptions cannot keep the caller.
    for (int i = 0; i < 1000; ++i) {
      if (!impl_->socket.recv(message, zmq::recv_flags::dontwait)) break;
      // 1 + prefix subscribes, 0 + prefix unsubscribes.
      const std::string text = message.to_string();
      if (!text.empty() && text[0] == 1) topics.push_back(text.substr(1));
    }
  } catch (const zmq::error_t&) {
    // A signal; the caller asks again.
  }
  return topics;
}

const std::string& Publisher::endpoint() const { return impl_->endpoint; }

}  // namespace panofix
