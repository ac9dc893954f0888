#include "common/sign/minisign.h"

#include <sodium.h>

#include <algorithm>
#include <cstring>
#include <stdexcept>
#include <vector>

#include "common/base/log.h"

namespace panofix {
namespace {

constexpr char kUntrustedPrefix[] = "untrusted comment: ";
constexpr char kTrustedPrefix[] = "trusted comment: ";
constexpr std::size_t kMaxFileBytes = std::size_t{16} << 10;
constexpr int kBase64 = sodium_base64_VARIANT_ORIGINAL;

void StartSodium() {
  static const bool started = sodium_init() >= 0;
  if (!started) throw std::runtime_error("libsodium does not start");
}

Status Bad(const std::string& name, const std::string& fault, const std::string& mend) {
  return {ErrorCode::kBadData, name + ": " + fault + "; " + mend};
}

constexpr char kKeyMend[] = "name a public key that minisign -G or panofix-builder keygen wrote";
constexpr char kSignatureMend[] = "sign again with panofix-builder sign or minisign -S";

// Lines without their ends; a carriage return counts to the end.
std::vector<std::string_view> Lines(std::string_view text) {
  std::vector<std::string_view> lines;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    std::string_view line = text.substr(0, end);
    if (line.ends_with('\r')) line.remove_suffix(1);
    lines.push_back(line);
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return lines;
}

// Exactly `size` bytes in base64; empty where it is not.
std::vector<std::uint8_t> Decode(std::string_view text, std::size_t size) {
  std::vector<std::uint8_t> bytes(size);
  std::size_t got = 0;
  if (sodium_base642bin(bytes.data(), size, text.data(), text.size(), nullptr, &got, nullptr,
                        kBase64) != 0 ||
      got != size) {
    return {};
  }
  return bytes;
}

std::string Encode(const std::vector<std::uint8_t>& bytes) {
  std::string text(sodium_base64_encoded_len(bytes.size(), kBase64), '\0');
  sodium_bin2base64(text.data(), text.size(), bytes.data(), bytes.size(), kBase64);
  text.pop_back();  // its terminating zero
  return text;
}

// Printable on one line, and nothing that a terminal acts on.
bool IsOneLine(std::string_view text) {
  return std::none_of(text.begin(), text.end(), [](char c) {
    return static_cast<unsigned char>(c) < 0x20 || static_cast<unsigned char>(c) == 0x7F;
  });
}

}  // namespace

std::string KeyIdText(const std::array<std::uint8_t, 8>& id) {
  constexpr char kHex[] = "0123456789ABCDEF";
  std::string text;
  for (std::size_t i = id.size(); i-- > 0;) {  // a little-endian number
    text += kHex[id[i] >> 4];
    text += kHex[id[i] & 15];
  }
  return text;
}

std::optional<std::string> KeyIdFromText(std::string text) {
  for (char& c : text) {
    if (c >= 'a' && c <= 'f') c = static_cast<char>(c - 'a' + 'A');
  }
  if (text.size() != 16 || text.find_first_not_of("0123456789ABCDEF") != std::string::npos)
    return std::nullopt;
  return text;
}

Result<PublicKey> ParsePublicKey(std::string_view text, const std::string& name) {
  StartSodium();
  if (text.size() > kMaxFileBytes) return Bad(name, "too long for a public key", kKeyMend);
  const auto lines = Lines(text);
  const bool has_comment = !lines.empty() && lines[0].starts_with(kUntrustedPrefix);
  if (lines.size() != (has_comment ? 2U : 1U)) return Bad(name, "is no public key", kKeyMend);
  const auto bytes = Decode(lines.back(), 42);
  if (bytes.empty() || bytes[0] != 'E' || bytes[1] != 'd')
    return Bad(name, "is no public key", kKeyMend);
  PublicKey key;
  std::copy_n(bytes.begin() + 2, 8, key.id.begin());
  std::copy_n(bytes.begin() + 10, 32, key.key.begin());
  return key;
}

std::string FormatPublicKey(const PublicKey& key) {
  std::vector<std::uint8_t> bytes{'E', 'd'};
  bytes.insert(bytes.end(), key.id.begin(), key.id.end());
  bytes.insert(bytes.end(), key.key.begin(), key.key.end());
  return Format("%sminisign public key %s\n%s\n", kUntrustedPrefix, KeyIdText(key.id).c_str(),
                Encode(bytes).c_str());
}

Result<Signature> ParseSignature(std::string_view text, const std::string& name) {
  StartSodium();
  if (text.size() > kMaxFileBytes) return Bad(name, "too long for a signature", kSignatureMend);
  const auto lines = Lines(text);
  if (lines.size() != 4 || !lines[0].starts_with(kUntrustedPrefix) ||
      !lines[2].starts_with(kTrustedPrefix)) {
    return Bad(name, "is no minisign signature", kSignatureMend);
  }
  const auto bytes = Decode(lines[1], 74), global = Decode(lines[3], 64);
  Signature out;
  out.trusted_comment = lines[2].substr(std::strlen(kTrustedPrefix));
  if (bytes.empty() || global.empty() || bytes[0] != 'E' || (bytes[1] != 'D' && bytes[1] != 'd') ||
      out.trusted_comment.size() > kMaxTrustedCommentBytes || !IsOneLine(out.trusted_comment)) {
    return Bad(name, "is no minisign signature", kSignatureMend);
  }
  out.is_prehashed = bytes[1] == 'D';
  std::copy_n(bytes.begin() + 2, 8, out.key_id.begin());
  std::copy_n(bytes.begin() + 10, 64, out.signature.begin());
  std::copy_n(global.begin(), 64, out.global_signature.begin());
  return out;
}

std::string FormatSignature(const Signature& signature, const std::string& comment) {
  if (!IsOneLine(comment) || !IsOneLine(signature.trusted_comment))
    throw std::logic_error("a signature's comments are one line each");
  std::vector<std::uint8_t> bytes{'E',
                                  static_cast<std::uint8_t>(signature.is_prehashed ? 'D' : 'd')};
  bytes.insert(bytes.end(), signature.key_id.begin(), signature.key_id.end());
  bytes.insert(bytes.end(), signature.signature.begin(), signature.signature.end());
  const std::string global =
      Encode({signature.global_signature.begin(), signature.global_signature.end()});
  return Format("%s%s\n%s\n%s%s\n%s\n", kUntrustedPrefix, comment.c_str(), Encode(bytes).c_str(),
                kTrustedPrefix, signature.trusted_comment.c_str(), global.c_str());
}

std::array<std::uint8_t, 64> PrehashOf(std::string_view message) {
  StartSodium();
  std::array<std::uint8_t, 64> hash{};
  crypto_generichash(hash.data(), hash.size(),
                     reinterpret_cast<const std::uint8_t*>(message.data()), message.size(), nullptr,
                     0);
  return hash;
}

bool Verifies(std::string_view message, const Signature& signature, const PublicKey& key) {
  StartSodium();
  if (signature.key_id != key.id) return false;
  std::array<std::uint8_t, 64> hash{};
  const auto* data = reinterpret_cast<const std::uint8_t*>(message.data());
  std::size_t size = message.size();
  if (signature.is_prehashed) {
    hash = PrehashOf(message);
    data = hash.data(), size = hash.size();
  }
  if (crypto_sign_verify_detached(signature.signature.data(), data, size, key.key.data()) != 0)
    return false;
  std::vector<std::uint8_t> global(signature.signature.begin(), signature.signature.end());
  global.insert(global.end(), signature.trusted_comment.begin(), signature.trusted_comment.end());
  return crypto_sign_verify_detached(signature.global_signature.data(), global.data(),
                                     global.size(), key.key.data()) == 0;
}

}  // namespace panofix
