#pragma once
// Signs as minisign does, from a fixed seed and independently of the builder, so that tests of
// whatever verifies have anything to verify.

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>

#include "common/map/manifest.h"
#include "common/sign/key_ring.h"
#include "common/sign/minisign.h"
#include "common/sign/release_statement.h"

namespace panofix {

class TestSigner {
 public:
  explicit TestSigner(std::uint8_t seed);
  [[nodiscard]] const PublicKey& key() const { return key_; }
  [[nodiscard]] std::string id() const { return KeyIdText(key_.id); }
  [[nodiscard]] KeyRing ring() const { return {{key_}, {}}; }
  // The text of a .minisig file.
  [[nodiscard]] std::string Sign(const std::string& message, const std::string& trusted_comment,
                                 bool prehashed = true) const;
  // An endorsement of another key's file.
  [[nodiscard]] std::string Endorse(const PublicKey& other) const;

 private:
  PublicKey key_;
  std::array<std::uint8_t, 64> secret_{};
};

// A release that is good for years.
[[nodiscard]] ReleaseStatement StatementFor(const Manifest& manifest);

// Signs the manifest that lies in a bundle's folder. The statement is the manifest's, with
// `change`.
void SignFolder(const std::filesystem::path& bundle, const TestSigner& signer,
                const std::function<void(ReleaseStatement*)>& change = {});

}  // namespace panofix
