#include "runtime/service/record.h"

#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <stdexcept>

#include "common/base/cancel.h"
#include "common/base/log.h"
#include "common/drive/poses_csv.h"
#include "common/io/atomic_file.h"
#include "runtime/service/log_throttle.h"
#include "runtime/service/messages.h"
#include "runtime/service/sockets.h"
#include "runtime/service/topics.h"

namespace panofix {
namespace {

using Clock = std::chrono::steady_clock;

// poses.csv under a temporary name; removed again unless finished or holding rows.
class RowFile {
 public:
  explicit RowFile(const std::filesystem::path& path)
      : path_(path), part_(path.string() + ".part"), header_(FormatPoses({}, PoseFormat::kCsv)) {}
  RowFile(const RowFile&) = delete;
  RowFile& operator=(const RowFile&) = delete;
  ~RowFile() {
    if (file_ != nullptr) std::fclose(file_);
    if (num_rows_ == 0) {
      std::error_code ignored;
      std::filesystem::remove(part_, ignored);
    }
  }

  Status Open() {
    file_ = std::fopen(part_.c_str(), "wb");
    return file_ == nullptr ? Failure("cannot create") : Write(header_);
  }
  Status Append(const PoseRow& row) {
    const std::string text = FormatPoses({row}, PoseFormat::kCsv);
    if (Status status = Write(text.substr(header_.size())); !status.ok()) return status;
    ++num_rows_;
    return {};
  }
  Status Finish() {
    if (std::fclose(std::exchange(file_, nullptr)) != 0) return Failure("cannot write");
    if (Status status = SyncPath(part_); !status.ok()) return status;
    std::error_code error;
    std::filesystem::rename(part_, path_, error);
    if (error) {
      return {ErrorCode::kIo,
              path_.string() + ": " + error.message() + "; the rows are in " + part_};
    }
    const auto folder = path_.parent_path();
    return SyncPath(folder.empty() ? "." : folder);
  }
  [[nodiscard]] std::int64_t num_rows() const { return num_rows_; }

 private:
  Status Write(const std::string& text) {
    if (std::fwrite(text.data(), 1, text.size(), file_) != text.size() || std::fflush(file_) != 0) {
      return Failure("cannot write");
    }
    return {};
  }
  [[nodiscard]] Status Failure(const char* what) const {
    const int number = errno;
    return {number == ENOSPC ? ErrorCode::kNoSpace : ErrorCode::kIo,
            part_ + ": " + what + ": " + std::strerror(number) + "; check folder and free space"};
  }

  const std::filesystem::path path_;
  const std::string part_, header_;
  std::FILE* file_ = nullptr;
  std::int64_t num_rows_ = 0;
};

// What the log says while rows come in.
class Notes {
 public:
  void Refused(const std::string& why) { refused_log_.Warn("pose refused: " + why); }
  void Bundle(const BundleIdentity& bundle) {
    if (bundle.id == bundle_id_) return;
    bundle_id_ = bundle.id;
    LogInfo(Format("poses of bundle %s, build %lld, id %.12s%s", bundle.name.c_str(),
                   static_cast<long long>(bundle.build), bundle.id.c_str(),
                   bundle.is_signed ? "" : ", UNSIGNED"));
  }

 private:
  LogThrottle refused_log_;
  std::string bundle_id_;
};

Status ReceiveRows(const RecordOptions& options, Subscriber& subscriber, RowFile& file,
                   RunLog* log) {
  constexpr int kPoll_ms = 100;  // bounds the time to a stop
  Notes notes;
  auto last_row = Clock::now();
  while (!CancelRequested() && (options.count == 0 || file.num_rows() < options.count)) {
    auto message = subscriber.Receive(kPoll_ms);
    if (!message.ok()) return message.status();
    if (!message->has_value()) {
      const double idle_s = std::chrono::duration<double>(Clock::now() - last_row).count();
      if (options.idle_timeout_s > 0 && idle_s > options.idle_timeout_s) break;
      continue;
    }
    const auto result = UnpackResult((*message)->payload);
    if (!result.ok()) {
      notes.Refused(result.status().message());
      continue;
    }
    notes.Bundle(result->bundle);
    if (Status status = file.Append(result->row); !status.ok()) return status;
    log->frames.push_back(ToRunLogEntry(result->result));
    last_row = Clock::now();
  }
  return {};
}

Status RecordRows(const RecordOptions& options) {
  SubscriberOptions subscriber_options;
  subscriber_options.topics = {kPoseTopic};
  subscriber_options.max_message_bytes = std::size_t{1} << 20;  // a result takes about 1 kB
  subscriber_options.receive_queue_messages = 10'000;           // every row counts
  subscriber_options.security = options.security;
  auto subscriber = Subscriber::Open(options.poses, subscriber_options);
  if (!subscriber.ok()) return subscriber.status();
  RowFile file(options.out);
  if (Status status = file.Open(); !status.ok()) return status;
  if (options.on_ready) options.on_ready(subscriber->endpoint());
  RunLog log;
  if (Status status = ReceiveRows(options, *subscriber, file, &log); !status.ok()) return status;
  if (file.num_rows() == 0 && !CancelRequested()) {
    return {ErrorCode::kNotFound,
            Format("%s: no pose within %g s; is panofix-runtime serve running there, and frames "
                   "coming in?",
                   options.poses.c_str(), options.idle_timeout_s)};
  }
  if (Status status = file.Finish(); !status.ok()) return status;
  if (options.log) {
    if (Status status = WriteFileAtomically(*options.log, ToJson(log)); !status.ok()) return status;
  }
  LogInfo(Format("%s: %lld rows", options.out.c_str(), static_cast<long long>(file.num_rows())));
  return {};
}

}  // namespace

void RecordOptions::Check() const {
  const Status endpoint = CheckEndpoint("poses", poses);
  if (!endpoint.ok()) throw std::invalid_argument(endpoint.message());
  if (out.empty()) throw std::invalid_argument("out is empty; name the file to write");
  if (count < 0) throw std::invalid_argument("count must be 0 or above");
  if (!(idle_timeout_s >= 0)) throw std::invalid_argument("idle_timeout_s must be 0 or above");
}

Status Record(const RecordOptions& options) {
  try {
    options.Check();
    return RecordRows(options);
  } catch (const std::invalid_argument& error) {
    return {ErrorCode::kInvalidArgument, error.what()};
  } catch (const std::exception& error) {
    return {ErrorCode::kInternal, std::string("record: ") + error.what()};
  }
}

}  // namespace panofix
