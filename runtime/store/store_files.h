#pragma once
// The files of a vehicle's store, byte by byte in schemas/store.md, and the small ones among them
// as structs.

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/camera/camera.h"
#include "common/sign/key_ring.h"

namespace panofix {

struct StoreLayout {
  std::filesystem::path root;
  [[nodiscard]] std::filesystem::path config() const { return root / "store.json"; }
  [[nodiscard]] std::filesystem::path state() const { return root / "state.json"; }
  [[nodiscard]] std::filesystem::path keys() const { return root / "keys.json"; }
  [[nodiscard]] std::filesystem::path lock() const { return root / "lock"; }
  [[nodiscard]] std::filesystem::path objects() const { return root / "objects"; }
  [[nodiscard]] std::filesystem::path versions() const { return root / "versions"; }
  [[nodiscard]] std::filesystem::path staging() const { return root / "staging"; }
  [[nodiscard]] std::filesystem::path downloads() const { return root / "downloads"; }
  [[nodiscard]] std::filesystem::path object(const std::string& sha256) const {
    return objects() / sha256.substr(0, 2) / sha256;
  }
  [[nodiscard]] std::filesystem::path version(const std::string& id) const {
    return versions() / id;
  }
};

// store.json: what this vehicle takes. Written once.
struct StoreConfig {
  std::string map_name;
  Camera camera;
};

// state.json: which map it runs. Replaced as a whole, by one rename.
struct StoreState {
  std::string active, previous;  // bundle ids; empty = none
  bool is_proven = false;        // the active one has passed its health probe
  // While the active one is not proven: what `previous` was before it, and is again should the
  // probe fail.
  std::string before_previous;
  // The newest build that was ever installed here, and which bundle that was.
  std::int64_t highest_build = -1;
  std::string highest_id;
  std::int64_t time_floor_s = 0;  // it is not earlier than this, whatever the clock says
};

// keys.json: whose signatures count.
struct StoreKeys {
  KeyRing ring;
  std::vector<std::string> endorsed_by;  // by trusted key: an id, or "" where put in by hand
};

// kNotFound, kBadData; each names the file and the mend. A state that was
// never written is empty, but kBadData where versions are here.
[[nodiscard]] Result<StoreConfig> ReadStoreConfig(const StoreLayout& layout);
[[nodiscard]] Result<StoreState> ReadStoreState(const StoreLayout& layout);
[[nodiscard]] Result<StoreKeys> ReadStoreKeys(const StoreLayout& layout);
[[nodiscard]] Status WriteStoreConfig(const StoreLayout& layout, const StoreConfig& config);
[[nodiscard]] Status WriteStoreState(const StoreLayout& layout, const StoreState& state);
[[nodiscard]] Status WriteStoreKeys(const StoreLayout& layout, const StoreKeys& keys);

// Whether `text` is 64 lower-case hex digits: all that may name an object or a version.
[[nodiscard]] bool IsSha256(const std::string& text);

}  // namespace panofix
