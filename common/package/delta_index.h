#pragma once
// delta.json, the first entry of a .pfb package: what the package is and what it builds on. It is
// not signed: all that it leads to is checked against the signed manifest.

#include <map>
#include <string>

#include "common/base/status.h"

namespace panofix {

inline constexpr char kDeltaIndexName[] = "delta.json";
inline constexpr std::size_t kMaxDeltaIndexBytes = std::size_t{64} << 20;
// Objects above this are shipped whole: a patch needs old and new in memory.
inline constexpr std::uint64_t kMaxPatchedBytes = std::uint64_t{512} << 20;

struct DeltaIndex {
  std::string base;                            // bundle id, or empty: needs nothing
  std::string target;                          // bundle id
  std::map<std::string, std::string> patches;  // SHA-256 of an object: that of what it patches
};

// Equal indices give equal text.
[[nodiscard]] std::string ToJson(const DeltaIndex& index);
// kBadData, kUnsupportedVersion; `name` is for messages.
[[nodiscard]] Result<DeltaIndex> ParseDeltaIndex(const std::string& text, const std::string& name);

[[nodiscard]] inline std::string ObjectEntryName(const std::string& sha256) {
  return "objects/" + sha256;
}
[[nodiscard]] inline std::string PatchEntryName(const std::string& sha256) {
  return "patches/" + sha256 + ".zst";
}
[[nodiscard]] inline std::string KeyEntryName(const std::string& key_id) {
  return "keys/" + key_id + ".pub";
}

// log2 of the window that a patch between such sizes may use: both sides derive it, so that no
// package chooses how much memory a vehicle takes.
[[nodiscard]] int PatchWindowLog(std::uint64_t base_bytes, std::uint64_t target_bytes);

}  // namespace panofix
