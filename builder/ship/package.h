#pragma once
// One file to carry: a signed bundle, or what of it changed. Throws Error.

#include <cstdint>
#include <filesystem>
#include <vector>

namespace panofix {

struct PackageReport {
  std::uint64_t num_bundle_bytes = 0, num_package_bytes = 0;
  std::size_t num_parts = 0, num_objects = 0, num_patches = 0;  // shipped whole, and as patches
};

// Writes `out` (.pfb) with the objects of the signed bundle `target` that `base` lacks: as patches
// on the part of the same path where that pays, else whole. An empty `base` ships all of it.
// `endorsed_keys` are public keys with their .minisig beside them, which vehicles take in on the
// way. Both bundles are read and checked whole. Equal arguments give equal bytes. kUntrusted where
// the target is not signed.
PackageReport WritePackage(const std::filesystem::path& base, const std::filesystem::path& target,
                           const std::vector<std::filesystem::path>& endorsed_keys,
                           const std::filesystem::path& out);

}  // namespace panofix
