#include "runtime/store/download.h"

#include <curl/curl.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <memory>

#include "common/base/cancel.h"
#include "common/base/log.h"
#include "common/io/atomic_file.h"
#include "common/io/read_file.h"
#include "common/io/sha256.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr std::size_t kMaxTagBytes = 1024;

// One URL on its way to one file.
class Transfer {
 public:
  Transfer(const StoreLayout& layout, const std::string& url, const DownloadOptions& options)
      : url_(url),
        options_(options),
        path_(layout.downloads() / (Sha256Hex(url).substr(0, 16) + ".pfb")),
        tag_path_(path_.string() + ".tag"),
        end_(Clock::now() + std::chrono::duration_cast<Clock::duration>(
                                std::chrono::duration<double>(options.timeout_s))) {}
  Result<Downloaded> Run();

 private:
  enum class Outcome { kDone, kRestart, kTryAgain, kFailed };
  Outcome Try();
  Outcome Judge(CURLcode code, long http_code);
  void SetOptions(CURL* curl, curl_slist* headers);
  Status Open();
  static std::size_t OnData(char* data, std::size_t size, std::size_t count, void* self);
  static std::size_t OnHeader(char* data, std::size_t size, std::size_t count, void* self);
  static int OnProgress(void*, curl_off_t, curl_off_t, curl_off_t, curl_off_t) {
    return CancelRequested() ? 1 : 0;
  }
  bool Append(const char* data, std::size_t size);
  [[nodiscard]] double SecondsLeft() const {
    return std::chrono::duration<double>(end_ - Clock::now()).count();
  }

  const std::string url_;
  const DownloadOptions& options_;
  const fs::path path_, tag_path_;
  const Clock::time_point end_;
  UniqueFd fd_;
  std::uint64_t size_ = 0;  // of the file so far
  std::string tag_, new_tag_;
  bool was_resumed_ = false;
  Status failure_;
};

Status Transfer::Open() {
  fd_ = UniqueFd(::open(path_.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0644));
  struct stat info {};
  if (!fd_.valid() || ::fstat(fd_.get(), &info) != 0) {
    return {ErrorCode::kIo, path_.string() + ": cannot be made (" + std::strerror(errno) +
                                "); make the store with panofix-runtime init"};
  }
  size_ = static_cast<std::uint64_t>(info.st_size);
  const auto tag = ReadFileText(tag_path_, kMaxTagBytes);
  tag_ = tag.ok() ? *tag : "";
  return {};
}

bool Transfer::Append(const char* data, std::size_t size) {
  if (size > options_.max_bytes - std::min(size_, options_.max_bytes)) {
    failure_ = {ErrorCode::kEndlessData,
                Format("%s: more than %llu bytes; name another address, or give a larger "
                       "--max-bytes if that is right",
                       url_.c_str(), static_cast<unsigned long long>(options_.max_bytes))};
    return false;
  }
  // What belongs to this file, before any byte of it: a later try asks for the same.
  if (!new_tag_.empty() && new_tag_ != tag_) {
    tag_ = new_tag_;
    failure_ = WriteFileAtomically(tag_path_, tag_);
    if (!failure_.ok()) return false;
  }
  while (size > 0) {
    const ssize_t put = ::pwrite(fd_.get(), data, size, static_cast<off_t>(size_));
    if (put < 0 && errno == EINTR) continue;
    if (put < 0) {
      const bool is_full = errno == ENOSPC || errno == EDQUOT;
      failure_ = {is_full ? ErrorCode::kNoSpace : ErrorCode::kIo,
                  path_.string() + ": writing failed (" + std::strerror(errno) +
                      "); free space on this disk (panofix-runtime gc) and run again"};
      return false;
    }
    data += put, size -= static_cast<std::size_t>(put), size_ += static_cast<std::uint64_t>(put);
  }
  return true;
}

std::size_t Transfer::OnData(char* data, std::size_t size, std::size_t count, void* self) {
  return static_cast<Transfer*>(self)->Append(data, size * count) ? size * count : 0;
}

std::size_t Transfer::OnHeader(char* data, std::size_t size, std::size_t count, void* self) {
  std::string line(data, size * count);
  if (line.starts_with("HTTP/")) static_cast<Transfer*>(self)->new_tag_.clear();
  const std::size_t colon = line.find(':');
  if (colon == 4 && ::strncasecmp(line.c_str(), "etag", colon) == 0) {
    const std::size_t begin = line.find_first_not_of(" \t", colon + 1);
    const std::size_t last = line.find_last_not_of(" \t\r\n");
    // Weak tags do not promise equal bytes.
    if (begin != std::string::npos && last >= begin && line[begin] == '"' &&
        last - begin < kMaxTagBytes) {
      static_cast<Transfer*>(self)->new_tag_ = line.substr(begin, last - begin + 1);
    }
  }
  return size * count;
}

void Transfer::SetOptions(CURL* curl, curl_slist* headers) {
  curl_easy_setopt(curl, CURLOPT_URL, url_.c_str());
  curl_easy_setopt(curl, CURLOPT_PROTOCOLS_STR, "http,https,file");
  curl_easy_setopt(curl, CURLOPT_REDIR_PROTOCOLS_STR, "http,https");
  curl_easy_setopt(curl, CURLOPT_FOLLOWLOCATION, 1L);
  curl_easy_setopt(curl, CURLOPT_MAXREDIRS, 5L);
  curl_easy_setopt(curl, CURLOPT_FAILONERROR, 1L);
  curl_easy_setopt(curl, CURLOPT_NOSIGNAL, 1L);
  curl_easy_setopt(curl, CURLOPT_CONNECTTIMEOUT, 15L);
  curl_easy_setopt(curl, CURLOPT_TIMEOUT_MS, static_cast<long>(1000 * SecondsLeft()) + 1);
  curl_easy_setopt(curl, CURLOPT_LOW_SPEED_LIMIT, 1000L);
  curl_easy_setopt(curl, CURLOPT_LOW_SPEED_TIME, static_cast<long>(options_.stall_s) + 1);
  curl_easy_setopt(curl, CURLOPT_HTTPHEADER, headers);
  curl_easy_setopt(curl, CURLOPT_RESUME_FROM_LARGE, static_cast<curl_off_t>(size_));
  curl_easy_setopt(curl, CURLOPT_WRITEFUNCTION, &Transfer::OnData);
  curl_easy_setopt(curl, CURLOPT_WRITEDATA, this);
  curl_easy_setopt(curl, CURLOPT_HEADERFUNCTION, &Transfer::OnHeader);
  curl_easy_setopt(curl, CURLOPT_HEADERDATA, this);
  curl_easy_setopt(curl, CURLOPT_NOPROGRESS, 0L);
  curl_easy_setopt(curl, CURLOPT_XFERINFOFUNCTION, &Transfer::OnProgress);
}

Transfer::Outcome Transfer::Judge(CURLcode code, long http_code) {
  constexpr long kRangeNotSatisfiable = 416;
  if (code == CURLE_OK) return Outcome::kDone;
  if (!failure_.ok()) return Outcome::kFailed;
  const std::string what = url_ + ": " + curl_easy_strerror(code);
  if (CancelRequested()) {
    failure_ = {ErrorCode::kCancelled, "stopped by the user; run it again to go on"};
    return Outcome::kFailed;
  }
  const bool cannot_resume = code == CURLE_RANGE_ERROR || code == CURLE_BAD_DOWNLOAD_RESUME ||
                             http_code == kRangeNotSatisfiable;
  if (size_ > 0 && cannot_resume) return Outcome::kRestart;
  if (SecondsLeft() <= 0) {
    failure_ = {ErrorCode::kEndlessData,
                Format("%s: not done within %.0f s; run it again to go on, or give a larger "
                       "--timeout-s",
                       url_.c_str(), options_.timeout_s)};
    return Outcome::kFailed;
  }
  switch (code) {
    case CURLE_HTTP_RETURNED_ERROR:
      failure_ = {http_code == 404 || http_code == 410 ? ErrorCode::kNotFound : ErrorCode::kIo,
                  Format("%s: the server answers %ld; check the address", url_.c_str(), http_code)};
      return http_code >= 500 ? Outcome::kTryAgain : Outcome::kFailed;
    case CURLE_FILE_COULDNT_READ_FILE:
    case CURLE_COULDNT_RESOLVE_HOST:
      failure_ = {ErrorCode::kNotFound, what + "; check the address"};
      return Outcome::kFailed;
    case CURLE_UNSUPPORTED_PROTOCOL:
    case CURLE_URL_MALFORMAT:
      failure_ = {ErrorCode::kInvalidArgument, what + "; give an http, https or file address"};
      return Outcome::kFailed;
    default:
      failure_ = {ErrorCode::kIo, what + "; check the network and run it again to go on"};
      return Outcome::kTryAgain;
  }
}

Transfer::Outcome Transfer::Try() {
  failure_ = Open();
  if (!failure_.ok()) return Outcome::kFailed;
  const std::unique_ptr<CURL, decltype(&curl_easy_cleanup)> curl(curl_easy_init(),
                                                                 &curl_easy_cleanup);
  curl_slist* headers = nullptr;
  if (size_ > 0 && !tag_.empty())
    headers = curl_slist_append(nullptr, ("If-Range: " + tag_).c_str());
  const std::unique_ptr<curl_slist, decltype(&curl_slist_free_all)> owner(headers,
                                                                          &curl_slist_free_all);
  was_resumed_ = was_resumed_ || size_ > 0;
  SetOptions(curl.get(), headers);
  const CURLcode code = curl_easy_perform(curl.get());
  long http_code = 0;
  curl_easy_getinfo(curl.get(), CURLINFO_RESPONSE_CODE, &http_code);
  return Judge(code, http_code);
}

Result<Downloaded> Transfer::Run() {
  static const bool started = curl_global_init(CURL_GLOBAL_DEFAULT) == CURLE_OK;
  if (!started) return Status(ErrorCode::kInternal, "libcurl does not start");
  std::error_code error;
  for (int tries = options_.num_tries; tries > 0; --tries) {
    const Outcome outcome = Try();
    if (outcome == Outcome::kDone) return Downloaded{path_, was_resumed_};
    if (outcome == Outcome::kRestart) {
      fs::remove(path_, error);
      was_resumed_ = false;
      ++tries;  // happens once: there is nothing to resume then
    }
    if (outcome == Outcome::kFailed) break;
    if (outcome == Outcome::kTryAgain) LogWarning(failure_.message());
  }
  // Too much of it is of no use later.
  if (failure_.code() == ErrorCode::kEndlessData && size_ + (1 << 20) > options_.max_bytes)
    fs::remove(path_, error);
  return failure_;
}

}  // namespace

Result<Downloaded> Download(const StoreLayout& layout, const std::string& url,
                            const DownloadOptions& options) {
  return Transfer(layout, url, options).Run();
}

Result<InstallReport> InstallFrom(const StoreLayout& layout, const std::string& from,
                                  const InstallOptions& install, const DownloadOptions& download) {
  std::error_code error;
  if (from.find("://") == std::string::npos) {
    const auto source =
        fs::is_directory(from, error) ? MakeFolderSource(from) : MakePackageSource(from);
    return Install(layout, *source, install);
  }
  const auto config = ReadStoreConfig(layout);
  if (!config.ok()) return config.status();
  while (true) {
    const auto fetched = Download(layout, from, download);
    if (!fetched.ok()) return fetched.status();
    const auto source = MakePackageSource(fetched->file);
    const auto report = Install(layout, *source, install);
    const ErrorCode code = report.status().code();
    // These do not speak against the package.
    if (code == ErrorCode::kTryAgain || code == ErrorCode::kNoSpace || code == ErrorCode::kIo ||
        code == ErrorCode::kCancelled) {
      return report;
    }
    fs::remove(fetched->file, error);
    fs::remove(fetched->file.string() + ".tag", error);
    if (report.ok() || !fetched->was_resumed) return report;
    LogWarning(report.status().message() + "; it was pieced together and is fetched anew");
  }
}

}  // namespace panofix
