#pragma once
// Keeping a store small and sound.

#include <cstdint>
#include <string>
#include <vector>

#include "runtime/store/store.h"

namespace panofix {

struct GarbageReport {
  std::vector<std::string> removed_versions;
  std::size_t num_removed_objects = 0;
  std::uint64_t num_freed_bytes = 0;
};

// Removes versions but the active one, the one before, the newest, and those that a running program
// has open (HoldVersion); what a revoked key signed is kept only where it is active or open. Then
// objects that no version uses, and what interrupted work left.
[[nodiscard]] Result<GarbageReport> CollectGarbage(const StoreLayout& layout);

// A version that is in use: garbage collection leaves it alone while this lives.
class VersionHold {
 public:
  [[nodiscard]] static Result<VersionHold> Take(const StoreLayout& layout, const std::string& id);

 private:
  UniqueFd fd_;
};

struct CheckReport {
  std::vector<std::string> faults;   // one line each
  std::vector<std::string> repairs;  // what was done about them, with `repair`
  std::size_t num_versions = 0, num_objects = 0;
  // Why no map is in force after damage, and the mend; ok where one is, or never was.
  Status in_force;
};

// Reads everything: signatures, sizes and hashes of all versions and objects, and the state. What a
// revoked key signed is garbage and no fault, unless it is active. With `repair`, damaged objects
// go, versions are linked anew from good ones, versions that cannot be mended go (their good
// objects stay), and a state that is unreadable, missing, or names a version that is gone is set to
// what is there, with floors as strict as what is installed tells.
[[nodiscard]] Result<CheckReport> CheckStore(const StoreLayout& layout, bool repair);

}  // namespace panofix
