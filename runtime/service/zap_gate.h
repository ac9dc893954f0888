#pragma once
// Answers ZeroMQ's question whether a key may connect (ZAP 1.0, RFC 27). Includes zmq.hpp: for .cc
// files of this module only.

#include <atomic>
#include <cstdint>
#include <set>
#include <string>
#include <thread>
#include <vector>
#include <zmq.hpp>

#include "runtime/service/log_throttle.h"

namespace panofix {

// One for a context; begins before the context's first socket binds, ends before the context does.
class ZapGate {
 public:
  // Z85 public keys. Throws zmq::error_t.
  ZapGate(zmq::context_t& context, const std::vector<std::string>& allowed);
  ~ZapGate();
  ZapGate(const ZapGate&) = delete;
  ZapGate& operator=(const ZapGate&) = delete;
  [[nodiscard]] std::int64_t num_denied() const { return num_denied_; }

 private:
  void Run();
  void Answer(const std::vector<std::string>& request);

  std::set<std::string> allowed_;  // as 32 bytes
  zmq::socket_t socket_;
  std::atomic<std::int64_t> num_denied_{0};
  LogThrottle log_;  // the thread's
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace panofix
