#include "runtime/service/replay.h"

#include <charconv>

#include "common/base/cancel.h"
#include "common/base/log.h"
#include "common/map/map_bundle.h"
#include "runtime/mcap/mcap_reader.h"
#include "runtime/service/messages.h"
#include "runtime/service/recording_names.h"
#include "runtime/service/topics.h"

namespace panofix {
namespace {

std::uint64_t NumberIn(const McapMetadata& metadata, const char* key) {
  const auto at = metadata.find(key);
  std::uint64_t number = 0;
  if (at != metadata.end()) {
    std::from_chars(at->second.data(), at->second.data() + at->second.size(), number);
  }
  return number;
}

std::string TextIn(const McapMetadata& metadata, const char* key) {
  const auto at = metadata.find(key);
  return at == metadata.end() ? "" : at->second;
}

// What must not differ, as bytes: an answer that went over the wire and back, without latencies,
// and without whose keys were given then and now.
Result<std::vector<std::uint8_t>> Essence(std::span<const std::uint8_t> packed) {
  auto answer = UnpackResult(WireBytes::Copy(packed));
  if (!answer.ok()) return answer.status();
  answer->result.latency = {};
  answer->result.map_is_unsigned = true;
  answer->bundle.is_signed = false;
  return PackResult(answer->result, answer->bundle, 0);
}

class Replayer {
 public:
  explicit Replayer(const ReplayOpener& open) : open_(open) {}
  Status Take(McapRecord record);
  ReplayReport report;

 private:
  void TakeMetadata(const McapRecord& record);
  Status TakeCamera(const WireBytes& payload);
  Status TakeFrame(const WireBytes& payload);
  Status TakePose(std::span<const std::uint8_t> payload);

  const ReplayOpener& open_;
  LocalizerOptions options_;
  std::string map_id_;
  std::uint64_t stop_at_step_ = 0;
  bool is_after_gap_ = false;
  std::unique_ptr<FrameEngine> engine_;
  std::optional<FrameResult> last_;
};

void Replayer::TakeMetadata(const McapRecord& record) {
  const McapMetadata& m = record.metadata;
  if (record.name == recording::kOptions) {
    options_.preset = TextIn(m, recording::kPreset);
    options_.seed = NumberIn(m, recording::kSeed);
    options_.add.clear();
    const std::string add = TextIn(m, recording::kAdd);
    for (std::size_t at = 0; at < add.size();) {
      const std::size_t end = std::min(add.find(',', at), add.size());
      options_.add.push_back(add.substr(at, end - at));
      at = end + 1;
    }
  } else if (record.name == recording::kMap) {
    map_id_ = TextIn(m, recording::kMapId);
    is_after_gap_ = false;
  } else if (record.name == recording::kGap) {
    is_after_gap_ = true;
  } else if (record.name == recording::kDeadline) {
    stop_at_step_ = NumberIn(m, recording::kStep);
  }
}

Status Replayer::TakeCamera(const WireBytes& payload) {
  const auto camera = UnpackCalibration(payload);
  if (!camera.ok()) return camera.status();
  auto engine = open_(map_id_, *camera, options_);
  if (!engine.ok()) return engine.status();
  engine_ = std::move(*engine);
  return {};
}

Status Replayer::TakeFrame(const WireBytes& payload) {
  const auto frame = UnpackFrame(payload);
  if (!frame.ok()) return frame.status();
  if (!engine_) return {ErrorCode::kBadData, "a frame before the map and the camera"};
  const auto gray = ConvertFrame(*frame, FrameLimitsFor(engine_->camera()));
  std::uint64_t step = 0;
  TimeIsUp time_is_up;
  if (stop_at_step_ > 0) {
    time_is_up = [&step, this] { return ++step >= stop_at_step_; };
  }
  last_ = gray.ok() ? engine_->Localize(frame->timestamp_ns, *gray, time_is_up)
                    : engine_->Undecodable(frame->timestamp_ns);
  last_->timestamp_ns = frame->timestamp_ns;
  stop_at_step_ = 0;
  ++report.num_frames;
  if (last_->status == FixStatus::kFix) ++report.num_fixes;
  report.rows.push_back(ToPoseRow(*last_));
  return {};
}

Status Replayer::TakePose(std::span<const std::uint8_t> payload) {
  if (!last_) return {ErrorCode::kBadData, "an answer without its frame"};
  const auto then = Essence(payload);
  if (!then.ok()) return then.status();
  const auto now = Essence(PackResult(*last_, engine_->bundle(), 0));
  if (!now.ok()) return now.status();
  // What the engine saw in a gap is not known here.
  if (is_after_gap_) {
    ++report.num_not_compared;
  } else if (*then != *now && report.num_different++ == 0) {
    report.first_different_ns = last_->timestamp_ns;
  }
  last_.reset();
  return {};
}

Status Replayer::Take(McapRecord record) {
  if (!record.is_message) {
    TakeMetadata(record);
    return {};
  }
  if (record.name == kPoseTopic) return TakePose(record.data);
  const WireBytes payload = WireBytes::Copy(record.data);
  if (record.name == kCameraTopic) return TakeCamera(payload);
  return record.name == kFrameTopic ? TakeFrame(payload) : Status();
}

}  // namespace

ReplayOpener OpenerOver(std::vector<std::filesystem::path> bundles, const KeyRing& trusted_keys) {
  return [bundles = std::move(bundles), trusted_keys](
             const std::string& map_id, const Camera& camera,
             LocalizerOptions options) -> Result<std::unique_ptr<FrameEngine>> {
    options.trusted_keys = trusted_keys;
    for (const std::filesystem::path& bundle : bundles) {
      std::string id;
      const auto manifest = MapBundle::ReadManifest(bundle, &id);
      if (!manifest.ok()) return manifest.status();
      if (id == map_id) return MakeLocalizerSource(bundle, options)->Open(camera);
    }
    return Status(ErrorCode::kNotFound, "the recording was made with map " + map_id +
                                            ", which is not among those given; name its folder "
                                            "with --bundle");
  };
}

Result<ReplayReport> Replay(const std::filesystem::path& recording, const ReplayOpener& open) {
  auto reader = McapReader::Open(recording);
  if (!reader.ok()) return reader.status();
  Replayer replayer(open);
  while (true) {
    if (CancelRequested()) return Status(ErrorCode::kCancelled, "replay: interrupted");
    auto record = reader->Next();
    if (!record.ok()) return record.status();
    if (!record->has_value()) break;
    if (const Status status = replayer.Take(std::move(**record)); !status.ok()) {
      return Status(status.code(), recording.string() + ": " + status.message());
    }
  }
  replayer.report.was_cut = reader->was_cut();
  return std::move(replayer.report);
}

}  // namespace panofix
