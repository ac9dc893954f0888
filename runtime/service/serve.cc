#include "runtime/service/serve.h"

#include <chrono>
#include <stdexcept>

#include "common/base/cancel.h"
#include "common/base/log.h"
#include "runtime/service/frame_receiver.h"
#include "runtime/service/log_throttle.h"
#include "runtime/service/messages.h"
#include "runtime/service/sockets.h"
#include "runtime/service/topics.h"

namespace panofix {
namespace {

using Clock = std::chrono::steady_clock;

double SecondsSince(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

bool SameCamera(const Camera& a, const Camera& b) {
  return a.width_px == b.width_px && a.height_px == b.height_px && a.fx_px == b.fx_px &&
         a.fy_px == b.fy_px && a.cx_px == b.cx_px && a.cy_px == b.cy_px &&
         a.distortion == b.distortion &&
         (a.distortion_model == b.distortion_model || !a.HasDistortion());
}

std::string Size(const Camera& camera) {
  return Format("%dx%d", camera.width_px, camera.height_px);
}

// One run of the service: a loop over the newest frames.
class Session {
 public:
  Session(const ServeOptions& options, EngineSource& source, Publisher publisher)
      : options_(options), source_(source), publisher_(std::move(publisher)) {}

  Status Run() {
    if (Status status = OpenEngine(); !status.ok()) return status;
    auto receiver = FrameReceiver::Open(
        {options_.frames, options_.max_message_bytes, options_.quiet_warning_s});
    if (!receiver.ok()) return receiver.status();
    receiver_ = std::move(*receiver);
    LogInfo("frames from " + receiver_->endpoint() + ", poses on " + publisher_.endpoint());
    if (options_.on_ready) options_.on_ready(publisher_.endpoint());
    while (!CancelRequested() && (options_.max_frames == 0 || num_answers_ < options_.max_frames)) {
      if (Status status = Step(); !status.ok()) return status;
    }
    Report();
    return {};
  }

 private:
  Status OpenEngine();
  Status Step();
  void HandleCalibration(const WireBytes& payload);
  bool CameraIsKnown();
  Status HandleFrame(const WireBytes& payload);
  Status Publish(const FrameResult& result, double decode_ms);
  void Report();

  const ServeOptions& options_;
  EngineSource& source_;
  Publisher publisher_;
  std::unique_ptr<FrameReceiver> receiver_;
  std::unique_ptr<FrameEngine> engine_;
  Camera bundle_camera_;
  bool camera_is_known_ = false;
  std::optional<Clock::time_point> first_frame_;
  Clock::time_point reported_ = Clock::now();
  std::int64_t num_answers_ = 0, num_fixes_ = 0, num_refused_ = 0, num_undecodable_ = 0;
  LogThrottle calibration_log_, frame_log_, decode_log_;
};

// The engine is opened before the first calibration can arrive, so that a bad bundle is told at
// once.
Status Session::OpenEngine() {
  auto bundle_camera = source_.BundleCamera();
  if (!bundle_camera.ok()) return bundle_camera.status();
  bundle_camera_ = *bundle_camera;
  Camera camera = bundle_camera_;
  if (options_.camera) {
    auto given = ReadCameraYaml(*options_.camera);
    if (!given.ok()) return given.status();
    camera = *given;
    camera_is_known_ = true;
  }
  auto engine = source_.Open(camera);
  if (!engine.ok()) return engine.status();
  engine_ = std::move(*engine);
  const BundleIdentity& bundle = engine_->bundle();
  LogInfo(Format("bundle %s, build %lld, id %.12s%s", bundle.name.c_str(),
                 static_cast<long long>(bundle.build), bundle.id.c_str(),
                 bundle.is_signed ? "" : ", UNSIGNED"));
  return {};
}

Status Session::Step() {
  constexpr std::chrono::milliseconds kWait(100);  // bounds the time to a stop
  static_cast<void>(publisher_.TakeSubscriptions(0));
  const auto frame = receiver_->TakeFrame(kWait);
  if (Status status = receiver_->status(); !status.ok()) return status;
  // After the frame: a camera sends its calibration first.
  if (const auto calibration = receiver_->TakeCalibration()) HandleCalibration(*calibration);
  if (SecondsSince(reported_) > options_.report_interval_s) Report();
  if (!frame) return {};
  if (!first_frame_) first_frame_ = Clock::now();
  return CameraIsKnown() ? HandleFrame(*frame) : Status();
}

void Session::HandleCalibration(const WireBytes& payload) {
  const auto camera = UnpackCalibration(payload);
  if (!camera.ok()) {
    calibration_log_.Warn("calibration refused: " + camera.status().message());
    return;
  }
  if (SameCamera(*camera, engine_->camera())) {
    camera_is_known_ = true;
    return;
  }
  if (options_.camera) {
    calibration_log_.Warn("calibration of the feed differs from " + options_.camera->string() +
                          "; the file is used");
    return;
  }
  if (camera->width_px != bundle_camera_.width_px ||
      camera->height_px != bundle_camera_.height_px) {
    calibration_log_.Warn("calibration refused: " + Size(*camera) +
                          " pixels, but the bundle is for " + Size(bundle_camera_) +
                          "; build a bundle for this camera");
    return;
  }
  auto engine = source_.Open(*camera);
  if (!engine.ok()) {
    calibration_log_.Warn("calibration refused: " + engine.status().message());
    return;
  }
  engine_ = std::move(*engine);
  camera_is_known_ = true;
  LogInfo("calibration taken from the feed");
}

// Frames before the calibration are left unanswered for a while: a wrong camera gives wrong poses.
bool Session::CameraIsKnown() {
  if (camera_is_known_ || SecondsSince(*first_frame_) < options_.camera_wait_s) {
    return camera_is_known_;
  }
  LogWarning(Format(
      "%s: no usable calibration on %s within %.1f s of the first frame; using the "
      "bundle's camera. Publish one, or give --camera",
      receiver_->endpoint().c_str(), std::string(kCameraTopic).c_str(), options_.camera_wait_s));
  camera_is_known_ = true;
  return true;
}

Status Session::HandleFrame(const WireBytes& payload) {
  const auto start = Clock::now();
  const auto frame = UnpackFrame(payload);
  if (!frame.ok()) {
    ++num_refused_;
    frame_log_.Warn(receiver_->endpoint() + ": frame refused: " + frame.status().message());
    return {};
  }
  const auto gray = ConvertFrame(*frame);
  const double decode_ms = 1e3 * SecondsSince(start);
  if (!gray.ok()) {
    ++num_undecodable_;
    decode_log_.Warn(Format("frame %lld: %s", static_cast<long long>(frame->timestamp_ns),
                            gray.status().message().c_str()));
  }
  FrameResult result = gray.ok() ? engine_->Localize(frame->timestamp_ns, *gray)
                                 : engine_->Undecodable(frame->timestamp_ns);
  result.timestamp_ns = frame->timestamp_ns;
  return Publish(result, decode_ms);
}

Status Session::Publish(const FrameResult& result, double decode_ms) {
  ++num_answers_;
  if (result.status == FixStatus::kFix) ++num_fixes_;
  const BundleIdentity& bundle = engine_->bundle();
  if (Status status = publisher_.Send(kPoseTopic, PackResult(result, bundle, decode_ms));
      !status.ok()) {
    return status;
  }
  if (!result.pose) return {};
  return publisher_.Send(kLocationFixTopic, PackLocationFix(result, bundle));
}

void Session::Report() {
  reported_ = Clock::now();
  const FrameReceiverCounters counters = receiver_->counters();
  const auto n = [](std::int64_t value) { return static_cast<long long>(value); };
  LogInfo(
      Format("answered %lld frames, %lld fixes; %lld replaced by newer ones, %lld refused, %lld "
             "undecodable, %lld malformed messages, %lld disconnects",
             n(num_answers_), n(num_fixes_), n(counters.dropped), n(num_refused_),
             n(num_undecodable_), n(counters.malformed), n(counters.disconnects)));
}

}  // namespace

void ServeOptions::Check() const {
  const auto require = [](bool holds, const char* rule) {
    if (!holds) throw std::invalid_argument(rule);
  };
  require(!bundle.empty(), "bundle is empty; name the bundle's folder");
  for (const Status& status : {CheckEndpoint("frames", frames), CheckEndpoint("poses", poses)}) {
    require(status.ok(), status.message().c_str());
  }
  require(camera_wait_s >= 0, "camera_wait_s must be 0 or above");
  require(max_message_bytes >= 1024, "max_message_bytes must be 1024 or above");
  require(quiet_warning_s > 0, "quiet_warning_s must be above 0");
  require(report_interval_s > 0, "report_interval_s must be above 0");
  require(max_frames >= 0, "max_frames must be 0 or above");
}

Status ServeFrom(const ServeOptions& options, EngineSource& source) {
  try {
    options.Check();
    auto publisher = Publisher::Bind(options.poses, {});
    if (!publisher.ok()) return publisher.status();
    return Session(options, source, std::move(*publisher)).Run();
  } catch (const std::invalid_argument& error) {
    return {ErrorCode::kInvalidArgument, error.what()};
  } catch (const std::exception& error) {
    return {ErrorCode::kInternal, std::string("serve: ") + error.what()};
  }
}

}  // namespace panofix
