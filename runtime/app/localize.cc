#include "runtime/app/localize.h"

#include "common/base/cancel.h"
#include "common/base/log.h"
#include "common/base/memory.h"
#include "common/base/progress.h"
#include "common/drive/drive.h"
#include "common/io/atomic_file.h"

namespace panofix {
namespace {

constexpr std::size_t kMaxFrameBytes = std::size_t{64} << 20;

FrameResult LocalizeFile(Localizer* localizer, const DriveFrame& frame) {
  const auto bytes = ReadFileBytes(frame.image, kMaxFrameBytes);
  if (!bytes.ok()) {
    LogWarning(bytes.status().message());
    return localizer->Undecodable(frame.timestamp_ns);
  }
  const auto image = DecodeGray(*bytes);
  if (!image.ok()) {
    LogWarning(frame.image.string() + ": " + image.status().message());
    return localizer->Undecodable(frame.timestamp_ns);
  }
  return localizer->Localize(frame.timestamp_ns, *image);
}

}  // namespace

Status LocalizeDrive(const LocalizeOptions& options) {
  const auto format = ParsePoseFormat(options.format);
  if (!format.ok()) return format.status();
  Status writable = CheckFileCanBeWritten(options.out, "--out");
  if (writable.ok() && options.log) writable = CheckFileCanBeWritten(*options.log, "--log");
  if (!writable.ok()) return writable;
  const auto drive = ReadDrive(options.drive);
  if (!drive.ok()) return drive.status();
  auto localizer = Localizer::Open(options.bundle, drive->camera, options.localizer);
  if (!localizer.ok()) return localizer.status();

  std::vector<PoseRow> rows;
  RunLog log;
  Progress progress("localize", static_cast<std::int64_t>(drive->frames.size()), "frames");
  for (const DriveFrame& frame : drive->frames) {
    if (CancelRequested()) break;
    const FrameResult result = LocalizeFile(localizer->get(), frame);
    rows.push_back(ToPoseRow(result));
    log.frames.push_back(ToRunLogEntry(result));
    progress.Add();
  }
  progress.Finish();
  Status status = WriteFileAtomically(options.out, FormatPoses(rows, *format));
  if (!status.ok()) return status;
  if (options.log) {
    log.resident_memory_bytes = PeakMemoryBytes();
    status = WriteFileAtomically(*options.log, ToJson(log));
    if (!status.ok()) return status;
  }
  if (rows.size() < drive->frames.size()) {
    return {ErrorCode::kCancelled,
            Format("stopped by the user after %zu of %zu frames; %s holds these", rows.size(),
                   drive->frames.size(), options.out.c_str())};
  }
  return {};
}

}  // namespace panofix
