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
  WireSecurity security;
};

// A ZeroMQ REP socket and a thread. A request [kFrameTopic, frame] is answered [kPoseTopic,
// result]; one that cannot be: [kErrorTopic, a line of text]. See schemas/messages.md.
class RequestServer {
 public:
  using Opened = Result<std::unique_ptr<FrameEngine>>;
  // `generation` is asked before each request: where it moved on, `open` makes the engine to use
  // from then on. Both are called in the server's thread.
  [[nodiscard]] static Result<std::unique_ptr<RequestServer>> Start(
      const RequestServerOptions& options, std::function<int()> generation,
      std::function<Opened()> open, ServiceMonitor& monitor);
  ~RequestServer();  // after the request under way
  RequestServer(const RequestServer&) = delete;
  RequestServer& operator=(const RequestServer&) = delete;
  [[nodiscard]] const std::string& endpoint() const;

 private:
  struct Impl;
  explicit RequestServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace panofix
