#include "runtime/service/frame_receiver.h"

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <thread>

#include "common/base/log.h"
#include "runtime/service/rate_limit.h"
#include "runtime/service/sockets.h"
#include "runtime/service/topics.h"

namespace panofix {

struct FrameReceiver::Impl {
  Impl(Subscriber source, const FrameReceiverOptions& receiver_options)
      : subscriber(std::move(source)),
        endpoint(subscriber.endpoint()),
        options(receiver_options),
        rate_limit(receiver_options.max_rate_hz),
        thread([this] { Run(); }) {}
  ~Impl() {
    stop = true;
    thread.join();
  }
  void Run();
  void Store(WireMessage message);
  void WatchQuiet(bool frame_arrived);

  Subscriber subscriber;  // the thread's alone
  const std::string endpoint;
  const FrameReceiverOptions options;
  std::chrono::steady_clock::time_point last_frame = std::chrono::steady_clock::now();
  bool is_quiet = false;
  RateLimit rate_limit;

  mutable std::mutex mutex;  // guards what follows
  std::condition_variable arrived;
  std::optional<ArrivedFrame> frame;
  std::vector<WireBytes> calibrations;
  FeedCounts counters;
  Status failure;

  std::atomic<bool> stop{false};
  std::thread thread;  // last: it uses all of the above
};

void FrameReceiver::Impl::Run() {
  constexpr int kPoll_ms = 50;
  while (!stop) {
    auto received = subscriber.Receive(kPoll_ms);
    bool is_frame = false;
    {
      const std::lock_guard lock(mutex);
      const SubscriberCounters wire = subscriber.counters();
      counters.malformed = wire.malformed;
      counters.wrong_topic = wire.wrong_topic;
      counters.connects = wire.connects;
      counters.disconnects = wire.disconnects;
      counters.denied = wire.denied;
      if (!received.ok()) {
        failure = received.status();
      } else if (received->has_value()) {
        is_frame = (*received)->topic == kFrameTopic;
        Store(std::move(**received));
      }
    }
    if (is_frame || !received.ok()) arrived.notify_all();
    if (!received.ok()) return;
    WatchQuiet(is_frame);
  }
}

// REQUIRES: mutex held.
void FrameReceiver::Impl::Store(WireMessage message) {
  if (message.topic != kFrameTopic) {
    ++counters.calibrations;
    constexpr std::size_t kMost = 8;  // each is sent every second; they are taken more often
    if (calibrations.size() == kMost) calibrations.erase(calibrations.begin());
    calibrations.push_back(std::move(message.payload));
    return;
  }
  ++counters.frames;
  if (!rate_limit.MayPass()) {
    ++counters.rate_limited;
    return;
  }
  if (frame) ++counters.replaced;
  frame = ArrivedFrame{std::move(message.payload), std::chrono::steady_clock::now()};
}

void FrameReceiver::Impl::WatchQuiet(bool frame_arrived) {
  const auto now = std::chrono::steady_clock::now();
  const double quiet_s = std::chrono::duration<double>(now - last_frame).count();
  if (frame_arrived) {
    if (is_quiet) LogInfo(Format("%s: frames again after %.1f s", endpoint.c_str(), quiet_s));
    is_quiet = false;
    last_frame = now;
  } else if (!is_quiet && quiet_s > options.quiet_warning_s) {
    is_quiet = true;
    LogWarning(Format("%s: no frame for %.1f s; is a camera publishing %s there? still waiting",
                      endpoint.c_str(), quiet_s, std::string(kFrameTopic).c_str()));
  }
}

FrameReceiver::FrameReceiver(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
FrameReceiver::~FrameReceiver() = default;

Result<std::unique_ptr<FrameReceiver>> FrameReceiver::Open(const FrameReceiverOptions& options) {
  SubscriberOptions subscriber_options;
  subscriber_options.topics = {kFrameTopic, kCameraTopic};
  subscriber_options.max_message_bytes = options.max_message_bytes;
  subscriber_options.security = options.security;
  auto subscriber = Subscriber::Open(options.endpoint, subscriber_options);
  if (!subscriber.ok()) return subscriber.status();
  auto impl = std::make_unique<Impl>(std::move(*subscriber), options);
  return std::unique_ptr<FrameReceiver>(new FrameReceiver(std::move(impl)));
}

std::optional<ArrivedFrame> FrameReceiver::TakeFrame(std::chrono::milliseconds timeout) {
  std::unique_lock lock(impl_->mutex);
  impl_->arrived.wait_for(lock, timeout, [this] { return impl_->frame || !impl_->failure.ok(); });
  return std::exchange(impl_->frame, std::nullopt);
}

std::vector<WireBytes> FrameReceiver::TakeCalibrations() {
  const std::lock_guard lock(impl_->mutex);
  return std::exchange(impl_->calibrations, {});
}

FeedCounts FrameReceiver::counters() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->counters;
}

Status FrameReceiver::status() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->failure;
}

const std::string& FrameReceiver::endpoint() const { return impl_->endpoint; }

}  // namespace panofix
