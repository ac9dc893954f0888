#pragma once
// Public keys and signatures in minisign's file formats (Ed25519; jedisct1.github.io/minisign), so
// that `minisign -V` reads what we write and the other way round.

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/base/status.h"

namespace panofix {

// Beside a signed FILE lies FILE.minisig.
inline constexpr char kSignatureSuffix[] = ".minisig";
// What minisign itself accepts of a trusted comment.
inline constexpr std::size_t kMaxTrustedCommentBytes = 8191;

struct PublicKey {
  std::array<std::uint8_t, 8> id{};
  std::array<std::uint8_t, 32> key{};
  bool operator==(const PublicKey&) const = default;
};

// 16 upper-case hex digits, as minisign prints them but for leading zeros.
[[nodiscard]] std::string KeyIdText(const std::array<std::uint8_t, 8>& id);
// The same from 16 hex digits of either case; nullopt otherwise, as a cut id would name another
// key.
[[nodiscard]] std::optional<std::string> KeyIdFromText(std::string text);

// The text of a .pub file (two lines), or its second line alone. kBadData; `name` is for messages.
[[nodiscard]] Result<PublicKey> ParsePublicKey(std::string_view text, const std::string& name);
[[nodiscard]] std::string FormatPublicKey(const PublicKey& key);

struct Signature {
  std::array<std::uint8_t, 8> key_id{};
  bool is_prehashed = true;  // of BLAKE2b-512 of the message; else of the message itself
  std::array<std::uint8_t, 64> signature{};
  std::string trusted_comment;                      // one line, signed too
  std::array<std::uint8_t, 64> global_signature{};  // of signature and trusted comment
};

// The text of a .minisig file (four lines, at most 16 KiB). kBadData.
[[nodiscard]] Result<Signature> ParseSignature(std::string_view text, const std::string& name);
[[nodiscard]] std::string FormatSignature(const Signature& signature, const std::string& comment);

// What a prehashed signature signs.
[[nodiscard]] std::array<std::uint8_t, 64> PrehashOf(std::string_view message);
// Whether `key` made the signature, of this message and with this trusted comment.
[[nodiscard]] bool Verifies(std::string_view message, const Signature& signature,
                            const PublicKey& key);

}  // namespace panofix
