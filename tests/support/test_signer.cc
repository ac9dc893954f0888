#include "tests/support/test_signer.h"

#include <sodium.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <vector>

#include "common/io/atomic_file.h"
#include "common/io/read_file.h"

namespace panofix {

TestSigner::TestSigner(std::uint8_t seed) {
  if (sodium_init() < 0) throw Error(ErrorCode::kInternal, "libsodium does not start");
  std::array<std::uint8_t, 32> bytes;
  bytes.fill(seed);
  crypto_sign_seed_keypair(key_.key.data(), secret_.data(), bytes.data());
  key_.id.fill(seed);
}

std::string TestSigner::Sign(const std::string& message, const std::string& trusted_comment,
                             bool prehashed) const {
  Signature out;
  out.key_id = key_.id;
  out.is_prehashed = prehashed;
  out.trusted_comment = trusted_comment;
  std::vector<std::uint8_t> data(message.begin(), message.end());
  if (prehashed) {
    std::vector<std::uint8_t> hash(64);
    crypto_generichash(hash.data(), hash.size(), data.data(), data.size(), nullptr, 0);
    data = hash;
  }
  crypto_sign_detached(out.signature.data(), nullptr, data.data(), data.size(), secret_.data());
  std::vector<std::uint8_t> global(out.signature.begin(), out.signature.end());
  global.insert(global.end(), trusted_comment.begin(), trusted_comment.end());
  crypto_sign_detached(out.global_signature.data(), nullptr, global.data(), global.size(),
                       secret_.data());
  return FormatSignature(out, "test");
}

std::string TestSigner::Endorse(const PublicKey& other) const {
  return Sign(FormatPublicKey(other), kEndorsement + KeyIdText(other.id));
}

ReleaseStatement StatementFor(const Manifest& manifest) {
  ReleaseStatement s;
  s.name = manifest.name, s.build = manifest.build;
  s.created_s = 1700000000;  // 2023
  s.expires_s = 4000000000;  // 2096
  return s;
}

void SignFolder(const std::filesystem::path& bundle, const TestSigner& signer,
                const std::function<void(ReleaseStatement*)>& change) {
  const std::string text = ValueOrThrow(ReadFileText(bundle / kManifestName, kMaxManifestBytes));
  // As JSON: the manifest need not be one that this release reads.
  const auto json = nlohmann::json::parse(text);
  Manifest manifest;
  json.at("name").get_to(manifest.name);
  json.at("build").get_to(manifest.build);
  ReleaseStatement statement = StatementFor(manifest);
  if (change) change(&statement);
  ThrowIfError(WriteFileAtomically(bundle / kManifestSignatureName,
                                   signer.Sign(text, ValueOrThrow(FormatStatement(statement)))));
}

}  // namespace panofix
