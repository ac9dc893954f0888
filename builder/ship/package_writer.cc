#include "builder/ship/package_writer.h"

#include <fcntl.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <vector>

#include "common/base/cancel.h"
#include "common/base/log.h"
#include "common/base/status.h"
#include "common/io/atomic_file.h"

namespace panofix {
namespace {

[[noreturn]] void FailWriting(const std::filesystem::path& path) {
  const bool is_full = errno == ENOSPC || errno == EDQUOT;
  throw Error(is_full ? ErrorCode::kNoSpace : ErrorCode::kIo,
              path.string() + ": writing failed (" + std::strerror(errno) +
                  "); free space there or choose another --out");
}

}  // namespace

PackageWriter::PackageWriter(const std::filesystem::path& path) : path_(path) {
  static std::atomic<unsigned> counter{0};
  aside_ = path_.string() + Format(".%ld-%u.tmp", static_cast<long>(::getpid()), counter++);
  fd_ = UniqueFd(::open(aside_.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0644));
  if (!fd_.valid()) FailWriting(path_);
}

PackageWriter::~PackageWriter() {
  if (!aside_.empty()) ::unlink(aside_.c_str());
}

void PackageWriter::Put(std::span<const std::uint8_t> bytes) {
  num_bytes_ += bytes.size();
  while (!bytes.empty()) {
    if (CancelRequested()) throw Error(ErrorCode::kCancelled, "stopped by the user; run it again");
    constexpr std::size_t kBlock = std::size_t{16} << 20;
    const ssize_t put = ::write(fd_.get(), bytes.data(), std::min(bytes.size(), kBlock));
    if (put < 0 && errno == EINTR) continue;
    if (put < 0) FailWriting(path_);
    bytes = bytes.subspan(static_cast<std::size_t>(put));
  }
}

void PackageWriter::Add(const std::string& name, std::span<const std::uint8_t> bytes) {
  if (bytes.size() > kMaxEntryBytes) {
    throw Error(ErrorCode::kTooLarge, path_.string() + ": " + name +
                                          " is larger than a package's entries may be (8 GiB); "
                                          "copy the bundle's folder instead");
  }
  Put(EncodeTarHeader({name, bytes.size()}));
  Put(bytes);
  Put(std::vector<std::uint8_t>(TarPadding(bytes.size()), 0));
}

void PackageWriter::Add(const std::string& name, std::string_view text) {
  Add(name, std::span(reinterpret_cast<const std::uint8_t*>(text.data()), text.size()));
}

void PackageWriter::Append(const PackageWriter& other) {
  std::vector<std::uint8_t> block(std::size_t{1} << 20);
  for (off_t at = 0;;) {
    const ssize_t got = ::pread(other.fd_.get(), block.data(), block.size(), at);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) FailWriting(path_);
    if (got == 0) return;
    Put(std::span(block).first(static_cast<std::size_t>(got)));
    at += got;
  }
}

void PackageWriter::Publish() {
  Put(TarBlock{});
  Put(TarBlock{});
  if (::fsync(fd_.get()) != 0 || ::rename(aside_.c_str(), path_.c_str()) != 0) FailWriting(path_);
  aside_.clear();
  const auto folder = path_.has_parent_path() ? path_.parent_path() : std::filesystem::path(".");
  ThrowIfError(SyncPath(folder));
}

}  // namespace panofix
