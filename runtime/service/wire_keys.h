#pragma once
// Keys of the wire: CURVE25519 pairs that encrypt a connection and tell who is at its ends.

#include <filesystem>
#include <string>

#include "common/base/status.h"

namespace panofix {

// ZeroMQ's printable form (Z85), 40 characters each.
struct WireKeyPair {
  std::string public_key, secret_key;
};

[[nodiscard]] Result<WireKeyPair> MakeWireKeys();
// NAME.key (for its owner only) and NAME.pub. kInvalidArgument where one of them is there already.
[[nodiscard]] Status WriteWireKeys(const WireKeyPair& keys, const std::filesystem::path& name);
// The pair of a .key file. kUntrusted where others may read it, kBadData where it is none.
[[nodiscard]] Result<WireKeyPair> ReadWireKeys(const std::filesystem::path& path);
// The key of a .pub file.
[[nodiscard]] Result<std::string> ReadWirePublicKey(const std::filesystem::path& path);

}  // namespace panofix
