#pragma once
// A vehicle's store of maps: made once, then only what is signed, newer and meant for this vehicle
// gets in. schemas/store.md has its files. Whatever is done to it, the active map stays whole: what
// is new is written beside, flushed, and comes into force by one rename.

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "common/map/bundle_files.h"
#include "runtime/store/store_files.h"

namespace panofix {

// The exclusive right to change a store; kTryAgain while another process has it.
class StoreLock {
 public:
  [[nodiscard]] static Result<StoreLock> Take(const StoreLayout& layout);

 private:
  UniqueFd fd_;
};

// Makes an empty store that takes maps of this name, for this camera, signed by one of these keys.
// kInvalidArgument where one is there already.
[[nodiscard]] Status InitStore(const StoreLayout& layout, const StoreConfig& config,
                               const KeyRing& keys);

// Takes a public key in. With a signature it must be an endorsement by a key that is trusted
// already; an empty `signature_text` means that whoever stands at the vehicle vouches for it.
[[nodiscard]] Status TrustKey(const StoreLayout& layout, const std::string& key_text,
                              const std::string& signature_text, const std::string& name);
// From now on nothing signed with this key is accepted. The last key in force cannot be revoked.
[[nodiscard]] Status RevokeKey(const StoreLayout& layout, const std::string& key_id_text);

// The manifest and release of an installed version, its signature verified. Parts are not looked
// at.
[[nodiscard]] Result<SignedManifest> ReadVersion(const StoreLayout& layout, const std::string& id);

struct StoreVersion {
  std::string id;
  Status status;            // why it cannot be used, as far as its manifest tells
  SignedManifest manifest;  // where status is ok
};
// Installed versions by build, oldest first; those without a readable manifest before all others.
[[nodiscard]] Result<std::vector<StoreVersion>> ListVersions(const StoreLayout& layout);

// Versions that the runtime may open, best first: the active one, the one before, then the others,
// newest first. Those that are refused are left out and logged with the reason. A state that cannot
// be read costs the order only. kNotFound where none is installed.
[[nodiscard]] Result<std::vector<std::string>> RunnableVersions(const StoreLayout& layout);

}  // namespace panofix
