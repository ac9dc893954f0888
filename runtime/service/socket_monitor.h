#pragma once
// What ZeroMQ says of a socket's connections. Includes zmq.hpp: for .cc files of this module only.

#include <string>
#include <vector>
#include <zmq.hpp>

namespace panofix {

struct SocketEvent {
  std::uint16_t number = 0;  // ZMQ_EVENT_…
  std::uint32_t value = 0;
  std::string address;  // of the endpoint
};

// Watches one socket; ends before it.
class SocketMonitor {
 public:
  // Throws zmq::error_t. `name` is unique within the context.
  SocketMonitor(zmq::context_t& context, zmq::socket_t& socket, const std::string& name);
  ~SocketMonitor();
  SocketMonitor(const SocketMonitor&) = delete;
  SocketMonitor& operator=(const SocketMonitor&) = delete;
  // What happened since the last call. Throws zmq::error_t.
  [[nodiscard]] std::vector<SocketEvent> Take();
  // Readable when something happened.
  [[nodiscard]] void* handle() { return monitor_.handle(); }

 private:
  zmq::socket_t& socket_;
  zmq::socket_t monitor_;
};

}  // namespace panofix
