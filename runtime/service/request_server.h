#pragma once
// Localizes single images on request, each on its own: nothing is remembered between them.

#include <functional>
#include <memory>
#include <string>

#include "runtime/service/frame_engine.h"
#include "runtime/service/wire_security.h"

namespace panofix {

struct RequestServerOptions {
  std::string endpoint;  // bound
  std::size_t max_message_bytes = std::size_t{64} << 20;
  double max_rate_hz = 0;  // requests beyond are refused; 0 = no bound
  // From the time that a request is read: work on it ends at the next step; 0 = none.
  double deadline_ms = 0;
  WireSecurity security;
};

// A ZeroMQ REP socket and a thread. A request [kFrameTopic, frame] is answered [kPoseTopic,
// result]; one that cannot be: [kErrorTopic, a line of text]. See schemas/messages.md.
class RequestServer {
 public:
  // `take_newer` is asked several times a second, in the server's thread: the engine to use from
  // then on, null where it stays. REQUIRES: it gives one when it is first asked.
  [[nodiscard]] static Result<std::unique_ptr<RequestServer>> Start(
      const RequestServerOptions& options, std::function<std::unique_ptr<FrameEngine>()> take_newer,
      ServiceMonitor& monitor);
  ~RequestServer();  // ends the request under way at its next step
  RequestServer(const RequestServer&) = delete;
  RequestServer& operator=(const RequestServer&) = delete;
  [[nodiscard]] const std::string& endpoint() const;

 private:
  struct Impl;
  explicit RequestServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace panofix
