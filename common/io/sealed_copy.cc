#include "common/io/sealed_copy.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <vector>

#include "common/base/log.h"
#include "common/io/sha256.h"

namespace panofix {
namespace {

Status Failed(const std::string& name, const char* what) {
  return {ErrorCode::kIo, name + ": " + what + " (" + std::strerror(errno) +
                              "); check the disk, and that memory is free"};
}

// write() and not a mapping: where memory is short it says so instead of a signal.
bool WriteAll(int fd, const std::uint8_t* bytes, std::size_t size) {
  while (size > 0) {
    const ssize_t put = ::write(fd, bytes, size);
    if (put < 0 && errno == EINTR) continue;
    if (put <= 0) return false;
    bytes += put, size -= static_cast<std::size_t>(put);
  }
  return true;
}

}  // namespace

Result<SealedCopy> CopyToMemory(int fd, std::uint64_t num_bytes, const std::string& name) {
  SealedCopy copy;
  copy.fd = UniqueFd(::memfd_create("panofix", MFD_CLOEXEC | MFD_ALLOW_SEALING));
  if (!copy.fd.valid()) return Failed(name, "no memory for it");
  constexpr std::uint64_t kBlockBytes = 1 << 18;
  std::vector<std::uint8_t> block(kBlockBytes);
  Sha256 hash;
  for (std::uint64_t at = 0; at < num_bytes;) {
    const std::uint64_t wanted = std::min(kBlockBytes, num_bytes - at);
    const ssize_t got = ::pread(fd, block.data(), wanted, static_cast<off_t>(at));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return Failed(name, "cannot be read");
    if (got == 0) {
      return Status(
          ErrorCode::kChecksumMismatch,
          Format("%s: ends after %llu of %llu bytes; fetch it again", name.c_str(),
                 static_cast<unsigned long long>(at), static_cast<unsigned long long>(num_bytes)));
    }
    const auto size = static_cast<std::size_t>(got);
    hash.Update(std::span(block).first(size));
    if (!WriteAll(copy.fd.get(), block.data(), size)) return Failed(name, "no memory for it");
    at += size;
  }
  if (::fcntl(copy.fd.get(), F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE) != 0)
    return Failed(name, "its copy cannot be sealed");
  copy.sha256 = hash.FinishHex();
  return copy;
}

}  // namespace panofix
