#include "runtime/store/object_pool.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "common/base/log.h"
#include "common/io/atomic_file.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

Status DiskStatus(const fs::path& path, const char* doing) {
  const int error = errno;
  const bool is_full = error == ENOSPC || error == EDQUOT;
  return {is_full ? ErrorCode::kNoSpace : ErrorCode::kIo,
          path.string() + ": " + doing + " failed (" + std::strerror(error) + "); " +
              (is_full ? "free space on this disk (panofix-runtime gc) and run again"
                       : "check the disk and its rights")};
}

}  // namespace

ObjectWriter::ObjectWriter(const StoreLayout& layout, const std::string& sha256,
                           std::uint64_t num_bytes)
    : layout_(layout),
      sha256_(sha256),
      num_bytes_(num_bytes),
      staged_(layout.staging() / ("object-" + sha256)) {}

Result<std::unique_ptr<ObjectWriter>> ObjectWriter::Begin(const StoreLayout& layout,
                                                          const std::string& sha256,
                                                          std::uint64_t num_bytes) {
  std::unique_ptr<ObjectWriter> writer(new ObjectWriter(layout, sha256, num_bytes));
  const fs::path& path = writer->staged_;
  ::unlink(path.c_str());
  writer->fd_ =
      UniqueFd(::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0444));
  if (!writer->fd_.valid()) return DiskStatus(path, "creating");
  return writer;
}

ObjectWriter::~ObjectWriter() {
  if (!is_committed_) ::unlink(staged_.c_str());
}

Status ObjectWriter::Write(std::span<const std::uint8_t> bytes) {
  if (bytes.size() > num_bytes_ - written_) {
    return {ErrorCode::kEndlessData,
            Format("part %.12s: more than the %llu bytes that the signed manifest states; get the "
                   "bundle from another place",
                   sha256_.c_str(), static_cast<unsigned long long>(num_bytes_))};
  }
  hash_.Update(bytes);
  written_ += bytes.size();
  while (!bytes.empty()) {
    const ssize_t put = ::write(fd_.get(), bytes.data(), bytes.size());
    if (put < 0 && errno == EINTR) continue;
    if (put < 0) return DiskStatus(staged_, "writing");
    bytes = bytes.subspan(static_cast<std::size_t>(put));
  }
  return {};
}

Status ObjectWriter::Commit() {
  if (written_ != num_bytes_) {
    return {ErrorCode::kIncomplete,
            Format("part %.12s: %llu of %llu bytes; fetch the bundle again", sha256_.c_str(),
                   static_cast<unsigned long long>(written_),
                   static_cast<unsigned long long>(num_bytes_))};
  }
  if (hash_.FinishHex() != sha256_) {
    return {ErrorCode::kMixedParts,
            Format("part %.12s: its bytes are not those that the signed manifest names; fetch the "
                   "bundle again, from one place",
                   sha256_.c_str())};
  }
  if (::fsync(fd_.get()) != 0) return DiskStatus(staged_, "flushing");
  const fs::path target = layout_.object(sha256_);
  std::error_code error;
  fs::create_directory(target.parent_path(), error);
  if (::rename(staged_.c_str(), target.c_str()) != 0) return DiskStatus(target, "placing");
  is_committed_ = true;
  const Status synced = SyncPath(target.parent_path());
  return synced.ok() ? SyncPath(layout_.objects()) : synced;
}

bool HasGoodObject(const StoreLayout& layout, const std::string& sha256, std::uint64_t num_bytes) {
  const fs::path path = layout.object(sha256);
  const UniqueFd fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
  struct stat info {};
  if (!fd.valid() || ::fstat(fd.get(), &info) != 0 || !S_ISREG(info.st_mode) ||
      static_cast<std::uint64_t>(info.st_size) != num_bytes) {
    return false;
  }
  const auto hash = Sha256OfDescriptor(fd.get(), path.string());
  return hash.ok() && *hash == sha256;
}

}  // namespace panofix
