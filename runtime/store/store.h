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
// From now on nothing signed with this key is accepted; one that is not known here is logged. The
// last key in force cannot be revoked, nor without `force` the one that signed the active version,
// which is not served again then (kInvalidArgument).
[[nodiscard]] Status RevokeKey(const StoreLayout& layout, const std::string& key_id_text,
                               bool force = false);

// The manifest and release of an installed version, its signature verified. Parts are not looked
// at.
[[nodiscard]] Result<SignedManifest> ReadVersion(const StoreLayout& layout, const std::string& id);

// The id of the one installed version that `text` begins: 6 digits at least. kNotFound,
// kInvalidArgument (too short, or several).
[[nodiscard]] Result<std::string> FindVersion(const StoreLayout& layout, const std::string& text);

struct StoreVersion {
  std::string id;
  Status status;  // why it cannot be used, as far as its manifest tells
  // Where the bytes are those that the id names, though their key may be revoked or unknown;
  // `release` only where a key verifies it that is trusted, or was. Else build -1.
  bool is_known = false;
  SignedManifest manifest;
  // What a revoked key signed is not damaged, but of no more use.
  [[nodiscard]] bool is_revoked() const { return status.code() == ErrorCode::kKeyRevoked; }
};
// Installed versions by build, oldest first; those that cannot be used before all others.
[[nodiscard]] Result<std::vector<StoreVersion>> ListVersions(const StoreLayout& layout);

// Makes `state` as strict as what is installed tells: the newest build, the latest release.
void RaiseFloors(const std::vector<StoreVersion>& versions, StoreState* state);

// Versions that the runtime may open, best first: the active one, the one before, then the others,
// newest first. Those that are refused are left out and logged with the reason. A state that cannot
// be read costs the order only. kNotFound where none is installed.
[[nodiscard]] Result<std::vector<std::string>> RunnableVersions(const StoreLayout& layout);

}  // namespace panofix
