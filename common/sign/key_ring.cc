#include "common/sign/key_ring.h"

#include <algorithm>

#include "common/io/read_file.h"

namespace panofix {

bool KeyRing::IsRevoked(const std::string& key_id) const {
  return std::find(revoked.begin(), revoked.end(), key_id) != revoked.end();
}

Result<PublicKey> KeyRing::Find(const Signature& signature, const std::string& name) const {
  const std::string id = KeyIdText(signature.key_id);
  if (IsRevoked(id)) {
    return Status(ErrorCode::kKeyRevoked, name + ": signed with key " + id +
                                              ", which was revoked; get one signed with the "
                                              "present key");
  }
  const auto key = std::find_if(trusted.begin(), trusted.end(),
                                [&](const PublicKey& k) { return k.id == signature.key_id; });
  if (key != trusted.end()) return *key;
  return Status(ErrorCode::kUntrusted, name + ": signed with key " + id +
                                           ", which is not trusted here; get one signed with a "
                                           "trusted key, or an endorsement of this key by one");
}

Result<Signature> VerifyWith(const KeyRing& ring, std::string_view message,
                             std::string_view signature_text, const std::string& name) {
  auto signature = ParseSignature(signature_text, name + kSignatureSuffix);
  if (!signature.ok()) return signature.status();
  const auto key = ring.Find(*signature, name);
  if (!key.ok()) return key.status();
  if (!Verifies(message, *signature, *key)) {
    return Status(ErrorCode::kUntrusted,
                  name +
                      ": its signature does not verify: file, signature or trusted comment was "
                      "changed; fetch it again, or sign it again");
  }
  return signature;
}

Result<PublicKey> VerifyEndorsement(const KeyRing& ring, std::string_view key_text,
                                    std::string_view signature_text, const std::string& name) {
  const auto signature = VerifyWith(ring, key_text, signature_text, name);
  if (!signature.ok()) return signature.status();
  auto key = ParsePublicKey(key_text, name);
  if (!key.ok()) return key.status();
  const std::string id = KeyIdText(key->id);
  if (signature->trusted_comment != kEndorsement + id) {
    return Status(ErrorCode::kUntrusted, name + ": signed, but not as an endorsement ('" +
                                             kEndorsement + id +
                                             "' as its trusted comment); make one with "
                                             "panofix-builder endorse");
  }
  if (ring.IsRevoked(id)) {
    return Status(ErrorCode::kKeyRevoked, name + ": key " + id + " was revoked; endorse a new key");
  }
  for (const PublicKey& known : ring.trusted) {
    if (known.id == key->id && known != *key) {
      return Status(ErrorCode::kUntrusted, name + ": another key with the id of " + id +
                                               ", which is trusted here; make a new key");
    }
  }
  return key;
}

Result<KeyRing> ReadKeyRing(const std::vector<std::filesystem::path>& files) {
  KeyRing ring;
  for (const std::filesystem::path& file : files) {
    constexpr std::size_t kMaxBytes = 4096;
    const auto text = ReadFileText(file, kMaxBytes);
    if (!text.ok()) return text.status();
    const auto key = ParsePublicKey(*text, file.string());
    if (!key.ok()) return key.status();
    ring.trusted.push_back(*key);
  }
  return ring;
}

}  // namespace panofix
