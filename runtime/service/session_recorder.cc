#include "runtime/service/session_recorder.h"

#include <chrono>
#include <condition_variable>
#include <ctime>
#include <deque>
#include <mutex>
#include <thread>

#include "common/base/log.h"
#include "runtime/mcap/mcap_writer.h"
#include "runtime/service/log_throttle.h"
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
  Impl(McapWriter mcap, ServiceMonitor& service_monitor, RecorderLimits recorder_limits)
      : writer(std::move(mcap)), limits(std::move(recorder_limits)), monitor(&service_monitor) {}

  struct Job {
    std::size_t num_bytes = 0;
    std::function<void()> write;
  };
  // False where too much waits already.
  bool Post(Job job, bool is_bounded);
  void Run();
  // Counts, and tells a failure once.
  void Note(const Status& status);
  Status AddChannels();

  // The thread's, once it has a job.
  McapWriter writer;
  bool has_failed = false;
  std::uint16_t compressed_id = 0, raw_id = 0, camera_id = 0, pose_id = 0;

  const RecorderLimits limits;
  bool has_gap = false;  // frames were left out since the last that was not
  LogThrottle gap_log;
  std::thread thread;
  std::mutex mutex;         // guards what follows
  ServiceMonitor* monitor;  // null once the thread is left behind: nobody is there to be told
  std::condition_variable changed;
  std::deque<Job> jobs;
  std::size_t num_waiting_bytes = 0;
  bool is_writing = false, stop = false, has_ended = false;
};

bool SessionRecorder::Impl::Post(Job job, bool is_bounded) {
  {
    const std::lock_guard lock(mutex);
    if (is_bounded && num_waiting_bytes + job.num_bytes > limits.max_waiting_bytes) return false;
    num_waiting_bytes += job.num_bytes;
    jobs.push_back(std::move(job));
  }
  changed.notify_all();
  return true;
}

void SessionRecorder::Impl::Run() {
  std::unique_lock lock(mutex);
  while (true) {
    changed.wait(lock, [&] { return stop || !jobs.empty(); });
    if (stop) break;
    const Job job = std::move(jobs.front());
    jobs.pop_front();
    is_writing = true;
    lock.unlock();
    if (limits.before_write) limits.before_write();
    job.write();
    lock.lock();
    is_writing = false;
    num_waiting_bytes -= job.num_bytes;
    changed.notify_all();
  }
  lock.unlock();
  if (!has_failed) Note(writer.Finish());
  lock.lock();
  has_ended = true;
  changed.notify_all();
}

void SessionRecorder::Impl::Note(const Status& status) {
  const std::lock_guard lock(mutex);
  if (monitor == nullptr) return;
  monitor->Count(status.ok() ? &MonitorSnapshot::num_recorded : &MonitorSnapshot::num_not_recorded);
  if (!status.ok() && !has_failed) Log(LogLevel::kError, status.message());
  has_failed = has_failed || !status.ok();
}

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

SessionRecorder::SessionRecorder(std::shared_ptr<Impl> impl) : impl_(std::move(impl)) {}
SessionRecorder::~SessionRecorder() { Finish(); }
const std::string& SessionRecorder::path() const { return impl_->writer.path(); }

Result<std::unique_ptr<SessionRecorder>> SessionRecorder::Create(const std::filesystem::path& path,
                                                                 const LocalizerOptions& options,
                                                                 ServiceMonitor& monitor,
                                                                 RecorderLimits limits) {
  auto writer = McapWriter::Create(FileIn(path));
  if (!writer.ok()) return writer.status();
  auto impl = std::make_shared<Impl>(std::move(*writer), monitor, std::move(limits));
  std::string levers;
  for (const std::string& lever : options.add) levers += (levers.empty() ? "" : ",") + lever;
  Status status = impl->writer.WriteMetadata(recording::kOptions,
                                             {{recording::kPreset, options.preset},
                                              {recording::kAdd, levers},
                                              {recording::kSeed, std::to_string(options.seed)}});
  if (status.ok()) status = impl->AddChannels();
  if (!status.ok()) return status;
  impl->thread = std::thread([impl] { impl->Run(); });
  return std::unique_ptr<SessionRecorder>(new SessionRecorder(std::move(impl)));
}

void SessionRecorder::AddEngine(const BundleIdentity& bundle, const Camera& camera) {
  Impl* const impl = impl_.get();
  const auto write = [=] {
    impl->Note(impl->writer.WriteMetadata(recording::kMap,
                                          {{recording::kMapName, bundle.name},
                                           {recording::kMapId, bundle.id},
                                           {recording::kMapBuild, std::to_string(bundle.build)}}));
    const std::uint64_t now_ns = NowNs();
    impl->Note(
        impl->writer.WriteMessage(impl->camera_id, now_ns, now_ns,
                                  PackCalibration(static_cast<std::int64_t>(now_ns), camera)));
  };
  impl->has_gap = false;  // the engine starts anew
  static_cast<void>(impl->Post({0, write}, false));
}

void SessionRecorder::AddAnswer(const IncomingFrame& frame, std::span<const std::uint8_t> answer,
                                int stopped_at_step) {
  Impl* const impl = impl_.get();
  const std::uint64_t now_ns = NowNs();
  const auto captured_ns = static_cast<std::uint64_t>(frame.timestamp_ns);
  const std::uint16_t frame_id =
      frame.kind == FrameKind::kCompressed ? impl->compressed_id : impl->raw_id;
  const bool is_after_gap = impl->has_gap;
  const auto write = [=, payload = frame.payload,
                      copy = std::vector<std::uint8_t>(answer.begin(), answer.end())] {
    if (is_after_gap) impl->Note(impl->writer.WriteMetadata(recording::kGap, {}));
    if (stopped_at_step > 0) {
      impl->Note(impl->writer.WriteMetadata(recording::kDeadline,
                                            {{recording::kStep, std::to_string(stopped_at_step)}}));
    }
    impl->Note(impl->writer.WriteMessage(frame_id, now_ns, captured_ns, payload.bytes));
    impl->Note(impl->writer.WriteMessage(impl->pose_id, now_ns, captured_ns, copy));
  };
  impl->has_gap = !impl->Post({frame.payload.bytes.size() + answer.size(), write}, true);
  if (!impl->has_gap) return;
  impl->monitor->Count(&MonitorSnapshot::num_not_recorded, 2);
  impl->gap_log.Warn(path() + ": the disk is too slow, frames are missing from the recording");
}

void SessionRecorder::Finish() {
  if (!impl_->thread.joinable()) return;
  const std::chrono::duration<double> patience(impl_->limits.finish_patience_s);
  std::unique_lock lock(impl_->mutex);
  impl_->changed.wait_for(lock, patience,
                          [&] { return impl_->jobs.empty() && !impl_->is_writing; });
  impl_->stop = true;
  impl_->changed.notify_all();
  const auto num_lost = static_cast<std::int64_t>(2 * impl_->jobs.size());
  if (num_lost > 0) impl_->monitor->Count(&MonitorSnapshot::num_not_recorded, num_lost);
  if (impl_->changed.wait_for(lock, patience, [&] { return impl_->has_ended; })) {
    lock.unlock();
    impl_->thread.join();
    return;
  }
  // Nothing wakes a thread that waits for a disk, and the end of the process must not.
  impl_->monitor = nullptr;
  impl_->thread.detach();
  LogWarning(path() + ": the disk does not answer; the recording may lack its end");
}

}  // namespace panofix
