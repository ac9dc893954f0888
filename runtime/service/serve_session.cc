#include "runtime/service/serve_session.h"

#include "common/base/cancel.h"
#include "common/base/log.h"
#include "runtime/service/frame_preview.h"
#include "runtime/service/topics.h"

namespace panofix {
namespace {

using Clock = std::chrono::steady_clock;

double MsSince(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

}  // namespace

ServeSession::ServeSession(const ServeOptions& options, EngineSource& source, Publisher publisher)
    : options_(options), engines_(options, source, monitor_), publisher_(std::move(publisher)) {}

Status ServeSession::Start() {
  if (Status status = engines_.Open(); !status.ok()) return status;
  if (options_.record) {
    auto recorder = SessionRecorder::Create(*options_.record, options_.localizer, monitor_);
    if (!recorder.ok()) return recorder.status();
    recorder_ = std::move(*recorder);
    LogInfo("recording to " + recorder_->path());
  }
  if (Status status = StartHttp(); !status.ok()) return status;
  if (Status status = StartRequests(); !status.ok()) return status;
  FrameReceiverOptions feed;
  feed.endpoint = options_.frames;
  feed.max_message_bytes = options_.max_message_bytes;
  feed.max_rate_hz = options_.max_rate_hz;
  feed.security = options_.frames_security;
  feed.quiet_warning_s = options_.quiet_warning_s;
  auto receiver = FrameReceiver::Open(feed);
  if (!receiver.ok()) return receiver.status();
  receiver_ = std::move(*receiver);
  LogInfo("frames from " + receiver_->endpoint() + ", poses on " + publisher_.endpoint());
  if (options_.on_ready) options_.on_ready(publisher_.endpoint());
  return {};
}

Status ServeSession::StartHttp() {
  if (!options_.http_port) return {};
  MonitorServerOptions http;
  http.port = *options_.http_port;
  http.quiet_s = options_.quiet_warning_s;
  auto server = MonitorServer::Start(http, monitor_);
  if (!server.ok()) return server.status();
  http_ = std::move(*server);
  LogInfo(
      Format("live page, /metrics, /healthz and /readyz on http://127.0.0.1:%d", http_->port()));
  if (options_.on_http) options_.on_http(http_->port());
  return {};
}

Status ServeSession::StartRequests() {
  if (options_.requests.empty()) return {};
  RequestServerOptions requests;
  requests.endpoint = options_.requests;
  requests.max_message_bytes = options_.max_message_bytes;
  requests.max_rate_hz = options_.max_rate_hz;
  requests.deadline_ms = options_.deadline_ms;
  requests.security = options_.poses_security;
  auto server = RequestServer::Start(
      requests, [this] { return engines_.TakeSpare(); }, monitor_);
  if (!server.ok()) return server.status();
  requests_ = std::move(*server);
  LogInfo("single images on request: " + requests_->endpoint());
  if (options_.on_requests) options_.on_requests(requests_->endpoint());
  return {};
}

Status ServeSession::Run() {
  if (Status status = Start(); !status.ok()) return status;
  while (!CancelRequested() && (options_.max_frames == 0 || num_answers_ < options_.max_frames)) {
    if (Status status = Step(); !status.ok()) return status;
  }
  if (recorder_) recorder_->Finish();
  Report();
  return {};
}

Status ServeSession::Step() {
  constexpr std::chrono::milliseconds kWait(100);  // bounds the time to a stop
  monitor_.Step();
  monitor_.SetFeed(receiver_->counters());
  if (Status status = engines_.TakeUpdate(); !status.ok()) return status;
  static_cast<void>(publisher_.TakeSubscriptions(0));
  monitor_.Set(&MonitorSnapshot::num_denied_users, publisher_.num_denied());
  const auto frame = receiver_->TakeFrame(kWait);
  if (Status status = receiver_->status(); !status.ok()) return status;
  // After the frame: a camera sends its calibration first.
  for (const WireBytes& calibration : receiver_->TakeCalibrations())
    engines_.TakeCalibration(calibration);
  if (MsSince(reported_) > 1e3 * options_.report_interval_s) Report();
  if (!frame) return {};
  if (!first_frame_) first_frame_ = Clock::now();
  if (engines_.CameraIsKnown(MsSince(*first_frame_) / 1e3)) return HandleFrame(*frame);
  monitor_.Count(&MonitorSnapshot::num_camera_unknown);
  return {};
}

Status ServeSession::HandleFrame(const ArrivedFrame& arrived) {
  FollowEngine();
  const double wait_ms = MsSince(arrived.arrived);
  const auto frame = UnpackFrame(arrived.payload);
  if (!frame.ok()) {
    monitor_.Count(&MonitorSnapshot::num_refused);
    frame_log_.Warn(receiver_->endpoint() + ": frame refused: " + frame.status().message());
    return {};
  }
  Answered answered = Answer(*frame, arrived.arrived);
  answered.result.timestamp_ns = frame->timestamp_ns;
  monitor_.AddAnswer(answered.result, wait_ms, answered.decode_ms);
  CountTiles();
  WatchDeadline(answered.result);
  ShowPicture(*frame, answered.result);
  return Publish(*frame, answered);
}

ServeSession::Answered ServeSession::Answer(const IncomingFrame& frame, Clock::time_point arrived) {
  const auto start = Clock::now();
  Answered answered;
  FrameEngine& engine = engines_.engine();
  const auto gray = ConvertFrame(frame, FrameLimitsFor(engine.camera()));
  answered.decode_ms = MsSince(start);
  if (!gray.ok()) {
    monitor_.Count(&MonitorSnapshot::num_undecodable);
    decode_log_.Warn(Format("frame %lld: %s", static_cast<long long>(frame.timestamp_ns),
                            gray.status().message().c_str()));
    answered.result = engine.Undecodable(frame.timestamp_ns);
    return answered;
  }
  int step = 0;
  const TimeIsUp time_is_up = [&, arrived] {
    ++step;
    const bool is_late = options_.deadline_ms > 0 && MsSince(arrived) >= options_.deadline_ms;
    if (!is_late && !CancelRequested()) return false;
    answered.stopped_at_step = step;
    return true;
  };
  answered.result = engine.Localize(frame.timestamp_ns, *gray, time_is_up);
  return answered;
}

void ServeSession::CountTiles() {
  const TileMemory memory = engines_.engine().memory();
  monitor_.Set(&MonitorSnapshot::num_tiles_loaded, memory.num_loaded);
  monitor_.Set(&MonitorSnapshot::num_tile_loads, memory.num_loads);
  monitor_.Set(&MonitorSnapshot::num_tiles_failed, memory.num_failed);
  monitor_.Set(&MonitorSnapshot::tile_bytes, static_cast<std::int64_t>(memory.num_bytes));
}

void ServeSession::WatchDeadline(const FrameResult& result) {
  constexpr int kMany = 20;
  if (result.pose) num_cut_ = 0;
  if (result.reason != "deadline" || ++num_cut_ != kMany || is_deadline_told_) return;
  is_deadline_told_ = true;
  LogWarning(
      Format("--deadline-ms %g ended the work on %d frames since the last pose: looking a place up "
             "takes longer than following it; give more time",
             options_.deadline_ms, kMany));
}

void ServeSession::ShowPicture(const IncomingFrame& frame, const FrameResult& result) {
  if (!http_) return;
  FramePicture picture;
  picture.timestamp_ns = frame.timestamp_ns;
  picture.sight = result.sight;
  if (frame.kind == FrameKind::kCompressed) {
    picture.owner = frame.payload.owner, picture.bytes = frame.data;
    picture.content_type = "image/" + frame.encoding;
  } else {
    const DecodeLimits limits = FrameLimitsFor(engines_.engine().camera());
    picture.preview =
        std::make_shared<LazyBytes>([frame, limits] { return EncodePreview(frame, limits); });
    picture.content_type = "image/jpeg";
  }
  monitor_.SetPicture(std::move(picture));
}

Status ServeSession::Publish(const IncomingFrame& frame, const Answered& answered) {
  ++num_answers_;
  const BundleIdentity& bundle = engines_.engine().bundle();
  const FrameResult& result = answered.result;
  const auto packed = PackResult(result, bundle, answered.decode_ms);
  // First the users, then the disk.
  Status status = publisher_.Send(kPoseTopic, packed);
  if (status.ok() && result.pose) {
    status = publisher_.Send(kLocationFixTopic, PackLocationFix(result, bundle));
  }
  // What no map answered cannot be replayed.
  if (recorder_ && !engines_.is_loading())
    recorder_->AddAnswer(frame, packed, answered.stopped_at_step);
  return status;
}

// Tells those who keep to one engine that it is another now.
void ServeSession::FollowEngine() {
  if (engines_.is_loading() || generation_ == engines_.generation()) return;
  generation_ = engines_.generation();
  const FrameEngine& engine = engines_.engine();
  if (recorder_) recorder_->AddEngine(engine.bundle(), engine.camera());
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
