#pragma once
// The secret half of a signing key, in minisign's file format. Throws Error.

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "common/sign/minisign.h"

namespace panofix {

class SecretKey {
 public:
  // A new random key.
  static SecretKey Generate();
  // The text of a .key file; `password` opens one that is encrypted. kBadData; kInvalidArgument
  // where the password is missing or wrong.
  static SecretKey Parse(std::string_view text, const std::string& password,
                         const std::string& name);
  static SecretKey Read(const std::filesystem::path& path, const std::string& password);
  ~SecretKey();  // wipes the key
  SecretKey(SecretKey&&) = default;
  SecretKey& operator=(SecretKey&&) = delete;

  [[nodiscard]] const PublicKey& public_key() const { return public_key_; }
  // As `minisign -G` writes it, encrypted unless the password is empty.
  [[nodiscard]] std::string Format(const std::string& password) const;
  // The text of MESSAGE.minisig. Equal arguments give equal text.
  [[nodiscard]] std::string Sign(std::string_view message,
                                 const std::string& trusted_comment) const;

 private:
  SecretKey() = default;
  PublicKey public_key_;
  std::array<std::uint8_t, 64> secret_{};
};

}  // namespace panofix
