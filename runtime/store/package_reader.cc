#include "runtime/store/package_reader.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <vector>

#include "common/base/log.h"

namespace panofix {

Result<PackageReader> PackageReader::Open(const std::filesystem::path& path) {
  UniqueFd fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  struct stat info {};
  if (!fd.valid() || ::fstat(fd.get(), &info) != 0 || !S_ISREG(info.st_mode)) {
    return Status(ErrorCode::kNotFound,
                  path.string() + ": no such package; name a .pfb file or a bundle's folder");
  }
  return PackageReader(std::move(fd), path.string());
}

Status PackageReader::ReadExactly(std::span<std::uint8_t> buffer) {
  while (!buffer.empty()) {
    const ssize_t got = ::read(fd_.get(), buffer.data(), buffer.size());
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) {
      return {ErrorCode::kIo,
              name_ + ": cannot be read (" + std::strerror(errno) + "); check the medium"};
    }
    if (got == 0) {
      return {ErrorCode::kIncomplete, name_ + ": ends before its time; fetch the package again"};
    }
    buffer = buffer.subspan(static_cast<std::size_t>(got));
  }
  return {};
}

Status PackageReader::SkipRest() {
  std::vector<std::uint8_t> block(std::size_t{64} << 10);
  while (left_ > 0) {
    const auto got = Read(block);
    if (!got.ok()) return got.status();
  }
  const std::size_t padding = TarPadding(entry_.num_bytes);
  const auto zeros = std::span(block).first(padding);
  const Status status = ReadExactly(zeros);
  if (!status.ok()) return status;
  if (std::any_of(zeros.begin(), zeros.end(), [](std::uint8_t b) { return b != 0; })) {
    return {ErrorCode::kBadData, name_ + ": bytes between its entries; fetch the package again"};
  }
  return {};
}

// A second block of zeros, and nothing after it.
Status PackageReader::CheckEnd() {
  TarBlock block{};
  const Status status = ReadExactly(block);
  if (!status.ok()) return status;
  std::uint8_t more = 0;
  if (block != TarBlock{} || ::read(fd_.get(), &more, 1) != 0) {
    return {ErrorCode::kBadData, name_ + ": bytes after its end; fetch the package again"};
  }
  return {};
}

Result<std::optional<PackageEntry>> PackageReader::Next() {
  if (has_entry_) {
    const Status skipped = SkipRest();
    if (!skipped.ok()) return skipped;
  }
  has_entry_ = false;
  TarBlock block{};
  Status status = ReadExactly(block);
  if (!status.ok()) return status;
  auto entry = DecodeTarHeader(block, name_);
  if (!entry.ok()) return entry;
  if (!*entry) {
    status = CheckEnd();
    if (!status.ok()) return status;
    return entry;
  }
  entry_ = **entry;
  left_ = entry_.num_bytes;
  has_entry_ = true;
  return entry;
}

Result<std::size_t> PackageReader::Read(std::span<std::uint8_t> buffer) {
  const auto size = static_cast<std::size_t>(std::min<std::uint64_t>(left_, buffer.size()));
  const Status status = ReadExactly(buffer.first(size));
  if (!status.ok()) return status;
  left_ -= size;
  return size;
}

Result<std::string> PackageReader::ReadAll(std::size_t max_bytes) {
  if (left_ > max_bytes) {
    return Status(ErrorCode::kEndlessData,
                  Format("%s: %s has %llu bytes, at most %zu are read; fetch the package again",
                         name_.c_str(), entry_.name.c_str(), static_cast<unsigned long long>(left_),
                         max_bytes));
  }
  std::string text(static_cast<std::size_t>(left_), '\0');
  const auto got = Read({reinterpret_cast<std::uint8_t*>(text.data()), text.size()});
  if (!got.ok()) return got.status();
  return text;
}

}  // namespace panofix
