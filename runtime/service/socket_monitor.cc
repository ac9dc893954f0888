#include "runtime/service/socket_monitor.h"

#include <cstring>

namespace panofix {
namespace {

constexpr int kEvents = ZMQ_EVENT_CONNECTED | ZMQ_EVENT_ACCEPTED | ZMQ_EVENT_DISCONNECTED |
                        ZMQ_EVENT_HANDSHAKE_SUCCEEDED | ZMQ_EVENT_HANDSHAKE_FAILED_NO_DETAIL |
                        ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL | ZMQ_EVENT_HANDSHAKE_FAILED_AUTH;

}  // namespace

SocketMonitor::SocketMonitor(zmq::context_t& context, zmq::socket_t& socket,
                             const std::string& name)
    : socket_(socket), monitor_(context, zmq::socket_type::pair) {
  const std::string address = "inproc://panofix.monitor." + name;
  if (zmq_socket_monitor(socket.handle(), address.c_str(), kEvents) != 0) throw zmq::error_t();
  monitor_.set(zmq::sockopt::linger, 0);
  monitor_.connect(address);
}

SocketMonitor::~SocketMonitor() { zmq_socket_monitor(socket_.handle(), nullptr, 0); }

std::vector<SocketEvent> SocketMonitor::Take() {
  std::vector<SocketEvent> events;
  zmq::message_t head, address;
  while (monitor_.recv(head, zmq::recv_flags::dontwait)) {
    if (head.more() && !monitor_.recv(address)) break;
    SocketEvent event;
    if (head.size() < sizeof(event.number) + sizeof(event.value)) continue;
    const auto* bytes = head.data<std::uint8_t>();
    std::memcpy(&event.number, bytes, sizeof(event.number));
    std::memcpy(&event.value, bytes + sizeof(event.number), sizeof(event.value));
    event.address = address.to_string();
    events.push_back(std::move(event));
  }
  return events;
}

}  // namespace panofix
