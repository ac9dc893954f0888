#include "builder/ship/secret_key.h"

#include <sodium.h>

#include <algorithm>
#include <cstring>
#include <vector>

#include "common/base/log.h"
#include "common/base/status.h"
#include "common/io/read_file.h"

namespace panofix {
namespace {

constexpr int kBase64 = sodium_base64_VARIANT_ORIGINAL;
// The file's bytes: algorithms, salt and limits of the password's hash, then what it encrypts.
constexpr std::size_t kSaltAt = 6, kOpsAt = 38, kMemAt = 46, kBodyAt = 54, kFileBytes = 158;
constexpr std::size_t kBodyBytes = kFileBytes - kBodyAt;  // key id 8, secret key 64, checksum 32
constexpr std::uint64_t kMaxMemory = std::uint64_t{2} << 30;
constexpr std::uint64_t kMaxOps = crypto_pwhash_scryptsalsa208sha256_OPSLIMIT_SENSITIVE * 4;

using Bytes = std::vector<std::uint8_t>;

void StartSodium() {
  if (sodium_init() < 0) throw Error(ErrorCode::kInternal, "libsodium does not start");
}

std::uint64_t Number(const Bytes& file, std::size_t at) {
  std::uint64_t value = 0;
  for (std::size_t i = 8; i-- > 0;) value = value << 8 | file[at + i];
  return value;
}

void PutNumber(std::uint64_t value, std::size_t at, Bytes* file) {
  for (std::size_t i = 0; i < 8; ++i) (*file)[at + i] = static_cast<std::uint8_t>(value >> (8 * i));
}

// Encrypts and decrypts alike.
void CryptBody(const std::string& password, const std::string& name, Bytes* file) {
  const std::uint64_t ops = Number(*file, kOpsAt), memory = Number(*file, kMemAt);
  Bytes stream(kBodyBytes);
  if (ops > kMaxOps || memory > kMaxMemory ||
      crypto_pwhash_scryptsalsa208sha256(stream.data(), stream.size(), password.data(),
                                         password.size(), file->data() + kSaltAt, ops,
                                         static_cast<std::size_t>(memory)) != 0) {
    throw Error(ErrorCode::kBadData,
                name + ": its password hash asks for too much memory; make a new key");
  }
  for (std::size_t i = 0; i < kBodyBytes; ++i) (*file)[kBodyAt + i] ^= stream[i];
  sodium_memzero(stream.data(), stream.size());
}

std::array<std::uint8_t, 32> Checksum(const Bytes& file) {
  Bytes input{'E', 'd'};
  input.insert(input.end(), file.begin() + kBodyAt, file.end() - 32);
  std::array<std::uint8_t, 32> sum{};
  crypto_generichash(sum.data(), sum.size(), input.data(), input.size(), nullptr, 0);
  sodium_memzero(input.data(), input.size());
  return sum;
}

Bytes Decoded(std::string_view text, const std::string& name) {
  const std::size_t line = text.find('\n');
  Bytes file(kFileBytes);
  std::size_t got = 0;
  if (line == std::string_view::npos || text.substr(0, 19) != "untrusted comment: " ||
      sodium_base642bin(file.data(), file.size(), text.data() + line + 1, text.size() - line - 1,
                        "\r\n", &got, nullptr, kBase64) != 0 ||
      got != kFileBytes || std::memcmp(file.data(), "Ed", 2) != 0 ||
      std::memcmp(file.data() + 4, "B2", 2) != 0) {
    throw Error(ErrorCode::kBadData,
                name +
                    ": is no minisign secret key; make one with minisign -G or "
                    "panofix-builder keygen");
  }
  return file;
}

}  // namespace

SecretKey SecretKey::Generate() {
  StartSodium();
  SecretKey key;
  crypto_sign_keypair(key.public_key_.key.data(), key.secret_.data());
  randombytes_buf(key.public_key_.id.data(), key.public_key_.id.size());
  return key;
}

SecretKey::~SecretKey() { sodium_memzero(secret_.data(), secret_.size()); }

SecretKey SecretKey::Parse(std::string_view text, const std::string& password,
                           const std::string& name) {
  StartSodium();
  Bytes file = Decoded(text, name);
  const bool is_encrypted = std::memcmp(file.data() + 2, "Sc", 2) == 0;
  if (is_encrypted && password.empty()) {
    throw Error(ErrorCode::kInvalidArgument,
                name +
                    ": is encrypted; give --password-file, or PANOFIX_KEY_PASSWORD in the "
                    "environment");
  }
  if (is_encrypted) CryptBody(password, name, &file);
  const auto sum = Checksum(file);
  if (!std::equal(sum.begin(), sum.end(), file.end() - 32) &&
      (is_encrypted || !std::all_of(file.end() - 32, file.end(), [](auto b) { return b == 0; }))) {
    throw Error(is_encrypted ? ErrorCode::kInvalidArgument : ErrorCode::kBadData,
                name + (is_encrypted ? ": the password is wrong; give the right one"
                                     : ": is damaged; take your copy of it"));
  }
  SecretKey key;
  std::copy_n(file.begin() + kBodyAt, 8, key.public_key_.id.begin());
  std::copy_n(file.begin() + kBodyAt + 8, 64, key.secret_.begin());
  crypto_sign_ed25519_sk_to_pk(key.public_key_.key.data(), key.secret_.data());
  sodium_memzero(file.data(), file.size());
  return key;
}

SecretKey SecretKey::Read(const std::filesystem::path& path, const std::string& password) {
  constexpr std::size_t kMaxBytes = 4096;
  return Parse(ValueOrThrow(ReadFileText(path, kMaxBytes)), password, path.string());
}

std::string SecretKey::Format(const std::string& password) const {
  StartSodium();
  Bytes file(kFileBytes, 0);
  std::memcpy(file.data(), "Ed\0\0B2", 6);
  std::copy(public_key_.id.begin(), public_key_.id.end(), file.begin() + kBodyAt);
  std::copy(secret_.begin(), secret_.end(), file.begin() + kBodyAt + 8);
  const auto sum = Checksum(file);
  std::copy(sum.begin(), sum.end(), file.end() - 32);
  if (!password.empty()) {
    std::memcpy(file.data() + 2, "Sc", 2);
    randombytes_buf(file.data() + kSaltAt, 32);
    PutNumber(crypto_pwhash_scryptsalsa208sha256_OPSLIMIT_SENSITIVE, kOpsAt, &file);
    PutNumber(crypto_pwhash_scryptsalsa208sha256_MEMLIMIT_SENSITIVE, kMemAt, &file);
    CryptBody(password, "new key", &file);
  }
  std::string text(sodium_base64_encoded_len(file.size(), kBase64), '\0');
  sodium_bin2base64(text.data(), text.size(), file.data(), file.size(), kBase64);
  sodium_memzero(file.data(), file.size());
  return panofix::Format("untrusted comment: minisign %s secret key %s\n%s\n",
                         password.empty() ? "unencrypted" : "encrypted",
                         KeyIdText(public_key_.id).c_str(), text.c_str());
}

std::string SecretKey::Sign(std::string_view message, const std::string& trusted_comment) const {
  Signature out;
  out.key_id = public_key_.id;
  out.trusted_comment = trusted_comment;
  const auto hash = PrehashOf(message);
  crypto_sign_detached(out.signature.data(), nullptr, hash.data(), hash.size(), secret_.data());
  Bytes global(out.signature.begin(), out.signature.end());
  global.insert(global.end(), trusted_comment.begin(), trusted_comment.end());
  crypto_sign_detached(out.global_signature.data(), nullptr, global.data(), global.size(),
                       secret_.data());
  return FormatSignature(out, "signature from panofix key " + KeyIdText(out.key_id));
}

}  // namespace panofix
