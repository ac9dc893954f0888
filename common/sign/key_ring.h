#pragma once
// The keys whose signatures count, those that were taken back, and how a key brings in the next.

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"
#include "common/sign/minisign.h"

namespace panofix {

// Begins the trusted comment of a signature over a public key file: its maker trusts that key.
inline constexpr char kEndorsement[] = "panofix endorses key ";

struct KeyRing {
  std::vector<PublicKey> trusted;
  std::vector<std::string> revoked;  // ids; a key that is in both is revoked

  [[nodiscard]] bool empty() const { return trusted.empty(); }
  [[nodiscard]] bool IsRevoked(const std::string& key_id) const;
  // The key that `signature` names. kUntrusted where it is not in the ring, kKeyRevoked; `name` is
  // the signed file's, for messages.
  [[nodiscard]] Result<PublicKey> Find(const Signature& signature, const std::string& name) const;
};

// A signature of `message` that a key of the ring made. kBadData, kUntrusted, kKeyRevoked.
[[nodiscard]] Result<Signature> VerifyWith(const KeyRing& ring, std::string_view message,
                                           std::string_view signature_text,
                                           const std::string& name);

// The key in `key_text`, where `signature_text` is its endorsement by a key of the ring.
[[nodiscard]] Result<PublicKey> VerifyEndorsement(const KeyRing& ring, std::string_view key_text,
                                                  std::string_view signature_text,
                                                  const std::string& name);

// The ring of the public keys in these files.
[[nodiscard]] Result<KeyRing> ReadKeyRing(const std::vector<std::filesystem::path>& files);

}  // namespace panofix
