#include "common/io/sha256.h"

#include <fcntl.h>
#include <openssl/evp.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <vector>

#include "common/io/unique_fd.h"

namespace panofix {
namespace {

constexpr std::size_t kBlockBytes = std::size_t{1} << 20;

Status ReadError(const std::string& name, int error) {
  return {ErrorCode::kIo, name + ": cannot be read (" + std::strerror(error) +
                              "); check the disk and the file's permissions"};
}

}  // namespace

struct Sha256::Impl {
  Impl() : context(EVP_MD_CTX_new()) {
    if (context == nullptr || EVP_DigestInit_ex(context, EVP_sha256(), nullptr) != 1) {
      throw std::runtime_error("OpenSSL offers no SHA-256");
    }
  }
  ~Impl() { EVP_MD_CTX_free(context); }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  // OpenSSL itself lets a finished digest be updated and answers nonsense.
  void RequireUnfinished() const {
    if (finished) throw std::logic_error("Sha256: used after FinishHex");
  }
  EVP_MD_CTX* context;
  bool finished = false;
};

Sha256::Sha256() : impl_(std::make_unique<Impl>()) {}
Sha256::~Sha256() = default;

void Sha256::Update(std::span<const std::uint8_t> bytes) {
  impl_->RequireUnfinished();
  if (EVP_DigestUpdate(impl_->context, bytes.data(), bytes.size()) != 1) {
    throw std::runtime_error("OpenSSL's SHA-256 failed");
  }
}

void Sha256::Update(std::string_view text) {
  Update({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

std::string Sha256::FinishHex() {
  impl_->RequireUnfinished();
  impl_->finished = true;
  std::uint8_t digest[EVP_MAX_MD_SIZE];
  unsigned int size = 0;
  if (EVP_DigestFinal_ex(impl_->context, digest, &size) != 1) {
    throw std::runtime_error("OpenSSL's SHA-256 failed");
  }
  constexpr char kHex[] = "0123456789abcdef";
  std::string hex;
  for (unsigned int i = 0; i < size; ++i) {
    hex += kHex[digest[i] >> 4];
    hex += kHex[digest[i] & 15];
  }
  return hex;
}

std::string Sha256Hex(std::string_view text) {
  Sha256 hash;
  hash.Update(text);
  return hash.FinishHex();
}

Result<std::string> Sha256OfDescriptor(int fd, const std::string& name_for_errors) {
  Sha256 hash;
  std::vector<std::uint8_t> block(kBlockBytes);
  off_t offset = 0;
  while (true) {
    const ssize_t got = ::pread(fd, block.data(), block.size(), offset);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return ReadError(name_for_errors, errno);
    if (got == 0) return hash.FinishHex();
    hash.Update(std::span(block).first(static_cast<std::size_t>(got)));
    offset += got;
  }
}

Result<std::string> Sha256OfFile(const std::filesystem::path& path) {
  const UniqueFd fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!fd.valid() && (errno == ENOENT || errno == ENOTDIR)) {
    return Status(ErrorCode::kNotFound, path.string() + ": no such file; name an existing one");
  }
  if (!fd.valid()) return ReadError(path.string(), errno);
  return Sha256OfDescriptor(fd.get(), path.string());
}

}  // namespace panofix
