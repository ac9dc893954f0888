#pragma once
// The headers of a .pfb package: an uncompressed ustar archive that `tar -tf` lists. Of tar only
// what the project writes exists here: regular files with short plain names. Anything else, links,
// folders, absolute or climbing names, other owners or times, is not a package.

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "common/base/status.h"

namespace panofix {

inline constexpr std::size_t kTarBlockBytes = 512;
using TarBlock = std::array<std::uint8_t, kTarBlockBytes>;

struct PackageEntry {
  std::string name;
  std::uint64_t num_bytes = 0;
};

// Eleven octal digits.
inline constexpr std::uint64_t kMaxEntryBytes = (std::uint64_t{1} << 33) - 1;

// The one header of such an entry: mode 0444, owner 0, time 0. std::logic_error on a name that
// IsPackageName refuses or a size beyond kMaxEntryBytes.
[[nodiscard]] TarBlock EncodeTarHeader(const PackageEntry& entry);

// The entry whose header is exactly `block`; nullopt for a block of zeros (the end). kBadData says
// what is wrong with anything else; `name` is the package's, for messages.
[[nodiscard]] Result<std::optional<PackageEntry>> DecodeTarHeader(const TarBlock& block,
                                                                  const std::string& name);

// delta.json, manifest.json, manifest.json.minisig, objects/SHA256, patches/SHA256.zst,
// keys/KEYID.pub, keys/KEYID.pub.minisig: nothing else is in a package.
[[nodiscard]] bool IsPackageName(const std::string& name);

// Bytes of zeros after an entry's content.
[[nodiscard]] inline std::size_t TarPadding(std::uint64_t num_bytes) {
  return static_cast<std::size_t>((kTarBlockBytes - num_bytes % kTarBlockBytes) % kTarBlockBytes);
}

}  // namespace panofix
