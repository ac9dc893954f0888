#pragma once
// Publisher and subscriber sockets of the wire; the only door to ZeroMQ, whose failures become
// Status here. Neither class is thread-safe; each may move to another thread before its first use
// there.

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"
#include "runtime/service/wire_bytes.h"
#include "runtime/service/wire_security.h"

namespace panofix {

// kInvalidArgument, naming `option`, unless `endpoint` reads tcp://HOST:PORT or ipc://PATH.
[[nodiscard]] Status CheckEndpoint(const std::string& option, const std::string& endpoint);

struct PublisherOptions {
  int send_queue_messages = 64;  // kept for a slow subscriber; what comes after is dropped for it
  int linger_ms = 1000;          // how long the destructor waits for the last messages to leave
  WireSecurity security;
};

class Publisher {
 public:
  // kIo or kInvalidArgument names the endpoint and the mend.
  [[nodiscard]] static Result<Publisher> Bind(const std::string& endpoint,
                                              const PublisherOptions& options);
  Publisher(Publisher&&) noexcept;
  Publisher& operator=(Publisher&&) noexcept;
  ~Publisher();

  // Never blocks. A message without a subscriber is gone.
  [[nodiscard]] Status Send(std::string_view topic, std::span<const std::uint8_t> payload);
  // Waits up to `timeout_ms` for subscribers and returns the topic prefixes that they asked for
  // since the last call ("" is everything). Call it now and then: subscriptions queue up.
  [[nodiscard]] std::vector<std::string> TakeSubscriptions(int timeout_ms);
  // Peers turned away: with a key that is not listed, or without one where one is asked for.
  [[nodiscard]] std::int64_t num_denied() const;
  // The bound address, with the port where the system chose it.
  [[nodiscard]] const std::string& endpoint() const;

 private:
  struct Impl;
  explicit Publisher(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

struct SubscriberOptions {
  std::vector<std::string_view> topics;
  std::size_t max_message_bytes = std::size_t{64} << 20;  // a larger one ends the connection
  int receive_queue_messages = 2;                         // 0 = no bound
  WireSecurity security;
};

struct SubscriberCounters {
  std::int64_t malformed = 0;    // not two parts
  std::int64_t wrong_topic = 0;  // two parts, but of no topic asked for
  std::int64_t connects = 0, disconnects = 0;
  std::int64_t denied = 0;  // peers that were turned away, or turned us away, for their or our key
};

struct WireMessage {
  std::string topic;
  WireBytes payload;
};

// Reconnects by itself; heartbeats find a publisher that is gone without a word.
class Subscriber {
 public:
  // Connects, or binds where the endpoint holds a '*'. A publisher need not be there yet.
  [[nodiscard]] static Result<Subscriber> Open(const std::string& endpoint,
                                               const SubscriberOptions& options);
  Subscriber(Subscriber&&) noexcept;
  Subscriber& operator=(Subscriber&&) noexcept;
  ~Subscriber();

  // The next well-formed message, or nothing within `timeout_ms`; counts and skips the others.
  [[nodiscard]] Result<std::optional<WireMessage>> Receive(int timeout_ms);
  [[nodiscard]] SubscriberCounters counters() const;
  // The bound address, or the one connected to.
  [[nodiscard]] const std::string& endpoint() const;

 private:
  struct Impl;
  explicit Subscriber(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace panofix
