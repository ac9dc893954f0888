#include "runtime/service/wire_keys.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zmq.h>

#include <cerrno>
#include <cstring>

#include "common/base/log.h"
#include "common/io/read_file.h"
#include "common/io/unique_fd.h"

namespace panofix {
namespace {

constexpr std::size_t kKeyChars = 40, kMaxFileBytes = 256;
constexpr const char* kSecretWord = "panofix-wire-secret ";
constexpr const char* kPublicWord = "panofix-wire-public ";

Status WriteNewFile(const std::filesystem::path& path, const std::string& text, mode_t mode) {
  const UniqueFd fd(::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode));
  if (fd.get() < 0 && errno == EEXIST) {
    return {ErrorCode::kInvalidArgument,
            path.string() + ": there is a key already; choose another name, or remove it"};
  }
  if (fd.get() < 0 ||
      ::write(fd.get(), text.data(), text.size()) != static_cast<ssize_t>(text.size()) ||
      ::fsync(fd.get()) != 0) {
    return {ErrorCode::kIo, path.string() + ": cannot write: " + std::strerror(errno) +
                                "; check folder and free space"};
  }
  return {};
}

Result<std::string> ReadKey(const std::filesystem::path& path, const std::string& word) {
  auto text = ReadFileText(path, kMaxFileBytes);
  if (!text.ok()) return text.status();
  while (!text->empty() && text->back() == '\n') text->pop_back();
  std::uint8_t binary[32];
  if (!text->starts_with(word) || text->size() != word.size() + kKeyChars ||
      zmq_z85_decode(binary, text->c_str() + word.size()) == nullptr) {
    return Status(ErrorCode::kBadData, path.string() + ": no line '" + word +
                                           "KEY'; make a pair with panofix-runtime wire-key");
  }
  return text->substr(word.size());
}

}  // namespace

Result<WireKeyPair> MakeWireKeys() {
  char public_key[kKeyChars + 1], secret_key[kKeyChars + 1];
  if (zmq_curve_keypair(public_key, secret_key) != 0) {
    return Status(ErrorCode::kInternal, "this libzmq has no CURVE; use Debian's");
  }
  return WireKeyPair{public_key, secret_key};
}

Status WriteWireKeys(const WireKeyPair& keys, const std::filesystem::path& name) {
  if (Status status = WriteNewFile(name.string() + ".key", kSecretWord + keys.secret_key + "\n",
                                   S_IRUSR | S_IWUSR);
      !status.ok()) {
    return status;
  }
  return WriteNewFile(name.string() + ".pub", kPublicWord + keys.public_key + "\n",
                      S_IRUSR | S_IWUSR | S_IRGRP | S_IROTH);
}

Result<WireKeyPair> ReadWireKeys(const std::filesystem::path& path) {
  auto secret = ReadKey(path, kSecretWord);
  if (!secret.ok()) return secret.status();
  struct stat info {};
  if (::stat(path.c_str(), &info) != 0 || (info.st_mode & (S_IRWXG | S_IRWXO)) != 0) {
    return Status(ErrorCode::kUntrusted,
                  path.string() + ": others may read this secret key; chmod 600 it");
  }
  char public_key[kKeyChars + 1];
  if (zmq_curve_public(public_key, secret->c_str()) != 0) {
    return Status(ErrorCode::kBadData, path.string() + ": no secret key; make a new pair");
  }
  return WireKeyPair{public_key, std::move(*secret)};
}

Result<std::string> ReadWirePublicKey(const std::filesystem::path& path) {
  return ReadKey(path, kPublicWord);
}

}  // namespace panofix
