#include "runtime/service/session_recorder.h"

#include <chrono>
#include <ctime>

#include "common/base/log.h"
#include "runtime/mcap/mcap_writer.h"
#include "runtime/service/messages.h"
#include "runtime/service/recording_names.h"
#include "runtime/service/topics.h"
#include "schemas/binary_schemas_generated.h"

namespace panofix {
namespace {

std::uint64_t NowNs() {
  return static_cast<std::uint64_t>(std::chrono::duration_cast<std::chrono::nanoseconds>(
                                        std::chrono::system_clock::now().time_since_epoch())
                                        .count());
}

std::filesystem::path FileIn(const std::filesystem::path& path) {
  if (!std::filesystem::is_directory(path)) return path;
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  char name[32];
  std::strftime(name, sizeof(name), "%Y%m%dT%H%M%SZ.mcap", &utc);
  return path / name;
}

}  // namespace

struct SessionRecorder::Impl {
  Impl(McapWriter mcap, ServiceMonitor& service_monitor)
      : writer(std::move(mcap)), monitor(service_monitor) {}

  // Counts, and tells a failure once.
  void Note(const Status& status) {
    monitor.Count(status.ok() ? &MonitorSnapshot::num_recorded
                              : &MonitorSnapshot::num_not_recorded);
    if (!status.ok() && !has_failed) Log(LogLevel::kError, status.message());
    has_failed = has_failed || !status.ok();
  }
  Status AddChannels();

  McapWriter writer;
  ServiceMonitor& monitor;
  bool has_failed = false;
  std::uint16_t compressed_id = 0, raw_id = 0, camera_id = 0, pose_id = 0;
};

Status SessionRecorder::Impl::AddChannels() {
  struct Wanted {
    std::string_view topic;
    McapWriter::Schema schema;
    std::uint16_t* id;
  };
  const char* encoding = "flatbuffer";
  for (const Wanted& wanted :
       {Wanted{kFrameTopic,
               {"foxglove.CompressedImage", encoding, kBytes_CompressedImage_bfbs},
               &compressed_id},
        Wanted{kFrameTopic, {"foxglove.RawImage", encoding, kBytes_RawImage_bfbs}, &raw_id},
        Wanted{kCameraTopic,
               {"foxglove.CameraCalibration", encoding, kBytes_CameraCalibration_bfbs},
               &camera_id},
        Wanted{kPoseTopic,
               {"panofix.wire.LocalizationResult", encoding, kBytes_LocalizationResult_bfbs},
               &pose_id}}) {
    const auto id = writer.AddChannel(std::string(wanted.topic), wanted.schema);
    if (!id.ok()) return id.status();
    *wanted.id = *id;
  }
  return {};
}

SessionRecorder::SessionRecorder(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
SessionRecorder::~SessionRecorder() = default;
const std::string& SessionRecorder::path() const { return impl_->writer.path(); }

Result<std::unique_ptr<SessionRecorder>> SessionRecorder::Create(const std::filesystem::path& path,
                                                                 const LocalizerOptions& options,
                                                                 ServiceMonitor& monitor) {
  auto writer = McapWriter::Create(FileIn(path));
  if (!writer.ok()) return writer.status();
  auto impl = std::make_unique<Impl>(std::move(*writer), monitor);
  std::string levers;
  for (const std::string& lever : options.add) levers += (levers.empty() ? "" : ",") + lever;
  Status status = impl->writer.WriteMetadata(recording::kOptions,
                                             {{recording::kPreset, options.preset},
                                              {recording::kAdd, levers},
                                              {recording::kSeed, std::to_string(options.seed)}});
  if (status.ok()) status = impl->AddChannels();
  if (!status.ok()) return status;
  return std::unique_ptr<SessionRecorder>(new SessionRecorder(std::move(impl)));
}

void SessionRecorder::AddEngine(const BundleIdentity& bundle, const Camera& camera) {
  impl_->Note(impl_->writer.WriteMetadata(recording::kMap,
                                          {{recording::kMapName, bundle.name},
                                           {recording::kMapId, bundle.id},
                                           {recording::kMapBuild, std::to_string(bundle.build)}}));
  const std::uint64_t now_ns = NowNs();
  impl_->Note(
      impl_->writer.WriteMessage(impl_->camera_id, now_ns, now_ns,
                                 PackCalibration(static_cast<std::int64_t>(now_ns), camera)));
}

void SessionRecorder::AddAnswer(const IncomingFrame& frame, std::span<const std::uint8_t> answer,
                                int stopped_at_step) {
  const std::uint64_t now_ns = NowNs();
  const auto captured_ns = static_cast<std::uint64_t>(frame.timestamp_ns);
  if (stopped_at_step > 0) {
    impl_->Note(impl_->writer.WriteMetadata(recording::kDeadline,
                                            {{recording::kStep, std::to_string(stopped_at_step)}}));
  }
  const std::uint16_t frame_id =
      frame.kind == FrameKind::kCompressed ? impl_->compressed_id : impl_->raw_id;
  impl_->Note(impl_->writer.WriteMessage(frame_id, now_ns, captured_ns, frame.payload.bytes));
  impl_->Note(impl_->writer.WriteMessage(impl_->pose_id, now_ns, captured_ns, answer));
}

void SessionRecorder::Finish() {
  if (!impl_->has_failed) impl_->Note(impl_->writer.Finish());
}

}  // namespace panofix
