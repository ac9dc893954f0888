#include "runtime/service/serve_session.h"

#include "common/base/cancel.h"
#include "common/base/log.h"
#include "runtime/service/topics.h"

namespace panofix {
namespace {

using Clock = std::chrono::steady_clock;

double MsSince(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

// A frame of another size than the camera's is of no use; decoding one much larger is a waste that
// a stranger could ask for.
DecodeLimits LimitsFor(const Camera& camera) {
  constexpr std::int64_t kFactor = 4, kLeast = 1'000'000;
  DecodeLimits limits;
  limits.max_pixels = kLeast + kFactor * camera.width_px * camera.height_px;
  return limits;
}

}  // namespace

ServeSession::ServeSession(const ServeOptions& options, EngineSource& source, Publisher publisher)
    : options_(options), engines_(options, source, monitor_), publisher_(std::move(publisher)) {}

Status ServeSession::Start() {
  if (Status status = engines_.Open(); !status.ok()) return status;
  if (options_.http_port) {
    MonitorServerOptions http;
    http.port = *options_.http_port;
    http.quiet_s = options_.quiet_warning_s;
    auto server = MonitorServer::Start(http, monitor_);
    if (!server.ok()) return server.status();
    http_ = std::move(*server);
    LogInfo(
        Format("live page, /metrics, /healthz and /readyz on http://127.0.0.1:%d", http_->port()));
  }
  auto receiver =
      FrameReceiver::Open({options_.frames, options_.max_message_bytes, options_.quiet_warning_s});
  if (!receiver.ok()) return receiver.status();
  receiver_ = std::move(*receiver);
  LogInfo("frames from " + receiver_->endpoint() + ", poses on " + publisher_.endpoint());
  if (options_.on_ready) options_.on_ready(publisher_.endpoint());
  if (options_.on_http && http_) options_.on_http(http_->port());
  return {};
}

Status ServeSession::Run() {
  if (Status status = Start(); !status.ok()) return status;
  while (!CancelRequested() && (options_.max_frames == 0 || num_answers_ < options_.max_frames)) {
    if (Status status = Step(); !status.ok()) return status;
  }
  Report();
  return {};
}

Status ServeSession::Step() {
  constexpr std::chrono::milliseconds kWait(100);  // bounds the time to a stop
  monitor_.Step();
  monitor_.SetFeed(receiver_->counters());
  engines_.TakeUpdate();
  static_cast<void>(publisher_.TakeSubscriptions(0));
  const auto frame = receiver_->TakeFrame(kWait);
  if (Status status = receiver_->status(); !status.ok()) return status;
  // After the frame: a camera sends its calibration first.
  if (const auto calibration = receiver_->TakeCalibration()) engines_.TakeCalibration(*calibration);
  if (MsSince(reported_) > 1e3 * options_.report_interval_s) Report();
  if (!frame) return {};
  if (!first_frame_) first_frame_ = Clock::now();
  if (engines_.CameraIsKnown(MsSince(*first_frame_) / 1e3)) return HandleFrame(*frame);
  monitor_.Count(&MonitorSnapshot::num_camera_unknown);
  return {};
}

Status ServeSession::HandleFrame(const ArrivedFrame& arrived) {
  const double wait_ms = MsSince(arrived.arrived);
  const auto frame = UnpackFrame(arrived.payload);
  if (!frame.ok()) {
    monitor_.Count(&MonitorSnapshot::num_refused);
    frame_log_.Warn(receiver_->endpoint() + ": frame refused: " + frame.status().message());
    return {};
  }
  double decode_ms = 0;
  FrameResult result = Answer(*frame, arrived.arrived, &decode_ms);
  result.timestamp_ns = frame->timestamp_ns;
  monitor_.AddAnswer(result, wait_ms, decode_ms);
  ShowPicture(*frame);
  return Publish(result, decode_ms);
}

FrameResult ServeSession::Answer(const IncomingFrame& frame, Clock::time_point arrived,
                                 double* decode_ms) {
  const auto start = Clock::now();
  FrameEngine& engine = engines_.engine();
  const auto gray = ConvertFrame(frame, LimitsFor(engine.camera()));
  *decode_ms = MsSince(start);
  if (!gray.ok()) {
    monitor_.Count(&MonitorSnapshot::num_undecodable);
    decode_log_.Warn(Format("frame %lld: %s", static_cast<long long>(frame.timestamp_ns),
                            gray.status().message().c_str()));
    return engine.Undecodable(frame.timestamp_ns);
  }
  TimeIsUp time_is_up;
  if (options_.deadline_ms > 0) {
    time_is_up = [this, arrived] { return MsSince(arrived) >= options_.deadline_ms; };
  }
  return engine.Localize(frame.timestamp_ns, *gray, time_is_up);
}

void ServeSession::ShowPicture(const IncomingFrame& frame) {
  if (!http_ || frame.kind != FrameKind::kCompressed) return;
  monitor_.SetPicture({frame.payload.owner, frame.data, "image/" + frame.encoding});
}

Status ServeSession::Publish(const FrameResult& result, double decode_ms) {
  ++num_answers_;
  const BundleIdentity& bundle = engines_.engine().bundle();
  if (Status status = publisher_.Send(kPoseTopic, PackResult(result, bundle, decode_ms));
      !status.ok()) {
    return status;
  }
  if (!result.pose) return {};
  return publisher_.Send(kLocationFixTopic, PackLocationFix(result, bundle));
}

void ServeSession::Report() {
  reported_ = Clock::now();
  monitor_.SetFeed(receiver_->counters());
  const MonitorSnapshot s = monitor_.Snapshot();
  const auto n = [](std::int64_t value) { return static_cast<long long>(value); };
  LogInfo(
      Format("answered %lld frames, %lld fixes; %lld replaced by newer ones, %lld refused, %lld "
             "undecodable, %lld malformed messages, %lld disconnects",
             n(s.num_answers), n(s.num_fixes), n(s.feed.replaced), n(s.num_refused),
             n(s.num_undecodable), n(s.feed.malformed), n(s.feed.disconnects)));
}

}  // namespace panofix
