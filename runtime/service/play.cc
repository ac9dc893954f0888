#include "runtime/service/play.h"

#include <chrono>
#include <cmath>
#include <stdexcept>

#include "common/base/cancel.h"
#include "common/base/log.h"
#include "common/drive/drive.h"
#include "common/image/gray_image.h"
#include "runtime/service/messages.h"
#include "runtime/service/sockets.h"
#include "runtime/service/topics.h"

namespace panofix {
namespace {

using Clock = std::chrono::steady_clock;
constexpr std::chrono::seconds kCalibrationInterval(1);
constexpr std::chrono::milliseconds kPoll(50);  // bounds the time to a stop
constexpr std::size_t kMaxFrameBytes = std::size_t{64} << 20;

std::int64_t NowNs() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

Result<std::string> FormatOf(std::span<const std::uint8_t> bytes, const std::string& name) {
  const auto starts_with = [bytes](std::initializer_list<std::uint8_t> magic) {
    return bytes.size() >= magic.size() && std::equal(magic.begin(), magic.end(), bytes.begin());
  };
  if (starts_with({0xff, 0xd8, 0xff})) return std::string("jpeg");
  if (starts_with({0x89, 'P', 'N', 'G'})) return std::string("png");
  return Status(ErrorCode::kBadData, name + ": neither JPEG nor PNG; convert the frame");
}

class Player {
 public:
  Player(const PlayOptions& options, Drive drive, Publisher publisher)
      : options_(options), drive_(std::move(drive)), publisher_(std::move(publisher)) {}

  Status Run() {
    if (options_.on_ready) options_.on_ready(publisher_.endpoint());
    if (options_.wait_for_subscriber) {
      if (Status status = WaitForSubscriber(); !status.ok()) return status;
    }
    next_frame_ = Clock::now();
    for (std::int64_t round = 0; round == 0 || options_.loop; ++round) {
      for (const DriveFrame& frame : drive_.frames) {
        if (Status status = WaitForTurn(); !status.ok()) return status;
        if (CancelRequested()) return {};
        if (Status status = SendFrame(frame, round); !status.ok()) return status;
      }
    }
    LogInfo(Format("%s: played %lld frames", publisher_.endpoint().c_str(),
                   static_cast<long long>(num_sent_)));
    return {};
  }

 private:
  Status WaitForSubscriber();
  Status WaitForTurn();
  Status SendCalibration();
  Status SendFrame(const DriveFrame& frame, std::int64_t round);
  [[nodiscard]] std::int64_t Timestamp(const DriveFrame& frame, std::int64_t round) const;

  const PlayOptions& options_;
  const Drive drive_;
  Publisher publisher_;
  Clock::time_point next_frame_, next_calibration_;
  std::int64_t num_sent_ = 0;
};

Status Player::WaitForSubscriber() {
  LogInfo(publisher_.endpoint() + ": waiting for a subscriber");
  const auto start = Clock::now();
  while (!CancelRequested()) {
    for (const std::string& prefix :
         publisher_.TakeSubscriptions(static_cast<int>(kPoll.count()))) {
      if (kFrameTopic.substr(0, prefix.size()) == prefix) return {};
    }
    const double waited_s = std::chrono::duration<double>(Clock::now() - start).count();
    if (options_.subscriber_timeout_s > 0 && waited_s > options_.subscriber_timeout_s) {
      return {ErrorCode::kNotFound,
              Format("%s: nobody subscribed to %s within %.1f s; start panofix-runtime serve there",
                     publisher_.endpoint().c_str(), std::string(kFrameTopic).c_str(), waited_s)};
    }
  }
  return {};
}

// Until the next frame is due: sends the calibration when it is due or somebody new asks for it.
Status Player::WaitForTurn() {
  while (!CancelRequested()) {
    const auto now = Clock::now();
    const auto due = std::chrono::ceil<std::chrono::milliseconds>(next_frame_ - now);
    const auto wait = std::clamp(due, std::chrono::milliseconds(0), kPoll);
    bool calibration_is_due = now >= next_calibration_;
    for (const std::string& prefix : publisher_.TakeSubscriptions(static_cast<int>(wait.count()))) {
      calibration_is_due |= kCameraTopic.substr(0, prefix.size()) == prefix;
    }
    if (calibration_is_due) {
      if (Status status = SendCalibration(); !status.ok()) return status;
    }
    if (Clock::now() >= next_frame_) break;
  }
  const auto period = std::chrono::duration_cast<Clock::duration>(
      std::chrono::duration<double>(1 / options_.rate_hz));
  next_frame_ = std::max(next_frame_ + period, Clock::now());
  return {};
}

Status Player::SendCalibration() {
  next_calibration_ = Clock::now() + kCalibrationInterval;
  return publisher_.Send(kCameraTopic, PackCalibration(NowNs(), drive_.camera));
}

Status Player::SendFrame(const DriveFrame& frame, std::int64_t round) {
  const auto bytes = ReadFileBytes(frame.image, kMaxFrameBytes);
  if (!bytes.ok()) return bytes.status();
  const auto format = FormatOf(*bytes, frame.image.string());
  if (!format.ok()) return format.status();
  const std::int64_t timestamp_ns = options_.restamp_now ? NowNs() : Timestamp(frame, round);
  if (!FitsWireTime(timestamp_ns)) {
    return {ErrorCode::kBadData,
            Format("%s: timestamp_ns %lld; must lie between 1970 and 2106, or restamp the frames",
                   frame.image.string().c_str(), static_cast<long long>(timestamp_ns))};
  }
  ++num_sent_;
  return publisher_.Send(kFrameTopic, PackFrame(timestamp_ns, *bytes, *format));
}

// Time never runs back at the start of another round.
std::int64_t Player::Timestamp(const DriveFrame& frame, std::int64_t round) const {
  const std::int64_t span_ns =
      drive_.frames.back().timestamp_ns - drive_.frames.front().timestamp_ns;
  const auto period_ns = static_cast<std::int64_t>(1e9 / options_.rate_hz);
  return frame.timestamp_ns + round * (span_ns + period_ns);
}

}  // namespace

void PlayOptions::Check() const {
  const auto require = [](bool holds, const std::string& rule) {
    if (!holds) throw std::invalid_argument(rule);
  };
  require(!drive.empty(), "drive is empty; name the drive's folder");
  const Status endpoint = CheckEndpoint("bind", bind);
  require(endpoint.ok(), endpoint.message());
  require(rate_hz >= 0.01 && rate_hz <= 1000,
          Format("rate_hz %g; must lie in 0.01..1000", rate_hz));
  require(subscriber_timeout_s >= 0, "subscriber_timeout_s must be 0 or above");
  require(linger_ms >= 0, "linger_ms must be 0 or above");
}

Status Play(const PlayOptions& options) {
  try {
    options.Check();
    auto drive = ReadDrive(options.drive);
    if (!drive.ok()) return drive.status();
    if (drive->frames.empty()) {
      return {ErrorCode::kBadData, options.drive.string() + ": frames.csv lists no frame"};
    }
    PublisherOptions publisher_options;
    publisher_options.linger_ms = options.linger_ms;
    publisher_options.security = options.security;
    auto publisher = Publisher::Bind(options.bind, publisher_options);
    if (!publisher.ok()) return publisher.status();
    return Player(options, std::move(*drive), std::move(*publisher)).Run();
  } catch (const std::invalid_argument& error) {
    return {ErrorCode::kInvalidArgument, error.what()};
  } catch (const std::exception& error) {
    return {ErrorCode::kInternal, std::string("play: ") + error.what()};
  }
}

}  // namespace panofix
