#pragma once
// SHA-256 (OpenSSL), as lower-case hex.

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "common/base/status.h"

namespace panofix {

// A hash built piece by piece; any use after FinishHex throws std::logic_error.
class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(const Sha256&) = delete;
  Sha256& operator=(const Sha256&) = delete;
  void Update(std::span<const std::uint8_t> bytes);
  void Update(std::string_view text);
  [[nodiscard]] std::string FinishHex();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

[[nodiscard]] std::string Sha256Hex(std::string_view text);
// Hash of everything readable from an open descriptor, read from offset 0 with pread.
[[nodiscard]] Result<std::string> Sha256OfDescriptor(int fd, const std::string& name_for_errors);
[[nodiscard]] Result<std::string> Sha256OfFile(const std::filesystem::path& path);

}  // namespace panofix
