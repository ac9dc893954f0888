#include "runtime/store/store.h"

#include <fcntl.h>
#include <sys/file.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <set>
#include <tuple>

#include "common/base/log.h"
#include "common/io/atomic_file.h"
#include "common/sign/utc_time.h"
#include "runtime/store/acceptance.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

Status CheckRing(const KeyRing& ring, const std::string& what) {
  const bool has_key = std::any_of(ring.trusted.begin(), ring.trusted.end(), [&](const auto& key) {
    return !ring.IsRevoked(KeyIdText(key.id));
  });
  if (has_key) return {};
  return {ErrorCode::kInvalidArgument,
          what + ": leaves no trusted key; trust another one first (panofix-runtime trust)"};
}

// Empty where this key did not sign the version in force.
std::string HarmOfRevoking(const StoreLayout& layout, const std::string& key_id) {
  const auto state = ReadStoreState(layout);
  if (!state.ok() || state->active.empty()) return {};
  const auto active = ReadVersion(layout, state->active);
  if (!active.ok() || !active->release || active->release->key_id != key_id) return {};
  return Format(
      "key %s signed the version in force, build %lld (%.12s), which is not served any more once "
      "the key is revoked",
      key_id.c_str(), static_cast<long long>(active->manifest.build), state->active.c_str());
}

}  // namespace

Result<StoreLock> StoreLock::Take(const StoreLayout& layout) {
  StoreLock lock;
  lock.fd_ = UniqueFd(::open(layout.lock().c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644));
  if (!lock.fd_.valid()) {
    return Status(errno == ENOENT ? ErrorCode::kNotFound : ErrorCode::kIo,
                  layout.root.string() + ": is no store that this user may change (" +
                      std::strerror(errno) + "); make one with panofix-runtime init --store");
  }
  if (::flock(lock.fd_.get(), LOCK_EX | LOCK_NB) != 0) {
    return Status(ErrorCode::kTryAgain, layout.root.string() +
                                            ": another process is changing this store; wait for "
                                            "it and run again");
  }
  return lock;
}

Status InitStore(const StoreLayout& layout, const StoreConfig& config, const KeyRing& keys) {
  if (config.map_name.empty())
    return {ErrorCode::kInvalidArgument, "--map is empty; name the map that this vehicle takes"};
  Status status = config.camera.Check();
  if (status.ok()) status = CheckRing(keys, "--key");
  if (!status.ok()) return status;
  if (fs::exists(layout.config())) {
    return {ErrorCode::kInvalidArgument,
            layout.root.string() + ": is a store already; use it, or name another folder"};
  }
  for (const fs::path& folder :
       {layout.root, layout.objects(), layout.versions(), layout.staging(), layout.downloads()}) {
    status = MakeDirectories(folder, "--store");
    if (!status.ok()) return status;
  }
  // Last what makes it a store.
  status = WriteStoreKeys(layout, {keys, std::vector<std::string>(keys.trusted.size())});
  if (status.ok() && !fs::exists(layout.state()) && ReadStoreState(layout).ok())
    status = WriteStoreState(layout, {});
  return status.ok() ? WriteStoreConfig(layout, config) : status;
}

Status TrustKey(const StoreLayout& layout, const std::string& key_text,
                const std::string& signature_text, const std::string& name) {
  const auto lock = StoreLock::Take(layout);
  if (!lock.ok()) return lock.status();
  auto keys = ReadStoreKeys(layout);
  if (!keys.ok()) return keys.status();
  std::string endorsed_by;
  auto key = ParsePublicKey(key_text, name);
  if (!signature_text.empty()) {
    key = VerifyEndorsement(keys->ring, key_text, signature_text, name);
    const auto signature = ParseSignature(signature_text, name);
    if (signature.ok()) endorsed_by = KeyIdText(signature->key_id);
  }
  if (!key.ok()) return key.status();
  if (keys->ring.IsRevoked(KeyIdText(key->id))) {
    return {ErrorCode::kKeyRevoked,
            name + ": key " + KeyIdText(key->id) + " was revoked here; make a new key"};
  }
  for (const PublicKey& known : keys->ring.trusted) {
    if (known.id == key->id) {
      if (known == *key) return {};
      return {ErrorCode::kUntrusted, name +
                                         ": another key of the same id is trusted already; make "
                                         "a new key"};
    }
  }
  keys->ring.trusted.push_back(*key);
  keys->endorsed_by.push_back(endorsed_by);
  return WriteStoreKeys(layout, *keys);
}

Status RevokeKey(const StoreLayout& layout, const std::string& key_id_text, bool force) {
  const auto key_id = KeyIdFromText(key_id_text);
  if (!key_id) {
    return {ErrorCode::kInvalidArgument,
            key_id_text + ": is no key id; give all its 16 hex digits, see panofix-runtime list"};
  }
  const auto lock = StoreLock::Take(layout);
  if (!lock.ok()) return lock.status();
  auto keys = ReadStoreKeys(layout);
  if (!keys.ok()) return keys.status();
  if (keys->ring.IsRevoked(*key_id)) return {};
  keys->ring.revoked.push_back(*key_id);
  const Status status = CheckRing(keys->ring, "revoking " + *key_id);
  if (!status.ok()) return status;
  const std::string harm = HarmOfRevoking(layout, *key_id);
  if (!harm.empty()) {
    if (!force) {
      return {ErrorCode::kInvalidArgument,
              harm +
                  "; first install and activate one that another trusted key signed, or give "
                  "--force"};
    }
    LogWarning(harm);
  }
  const auto& trusted = keys->ring.trusted;
  if (std::none_of(trusted.begin(), trusted.end(),
                   [&](const PublicKey& key) { return KeyIdText(key.id) == *key_id; })) {
    LogWarning("key " + *key_id +
               " is not known here; refused from now on all the same. Was it meant? See "
               "panofix-runtime list");
  }
  return WriteStoreKeys(layout, *keys);
}

Result<std::string> FindVersion(const StoreLayout& layout, const std::string& text) {
  constexpr std::size_t kFewestDigits = 6;
  const Status none{ErrorCode::kNotFound, layout.root.string() + ": no version " + text +
                                              " is installed; see panofix-runtime list --store"};
  if (IsSha256(text)) return text;
  if (text.find_first_not_of("0123456789abcdef") != std::string::npos) return none;
  if (text.size() < kFewestDigits) {
    return Status(ErrorCode::kInvalidArgument,
                  text + ": too short for a version's id; give 6 digits of it or more");
  }
  const auto versions = ListVersions(layout);
  if (!versions.ok()) return versions.status();
  std::string found;
  for (const StoreVersion& v : *versions) {
    if (!v.id.starts_with(text)) continue;
    if (!found.empty()) {
      return Status(ErrorCode::kInvalidArgument,
                    text + ": several versions begin so; give more digits of the id");
    }
    found = v.id;
  }
  if (found.empty()) return none;
  return found;
}

Result<SignedManifest> ReadVersion(const StoreLayout& layout, const std::string& id) {
  const auto keys = ReadStoreKeys(layout);
  if (!keys.ok()) return keys.status();
  if (!IsSha256(id) || !fs::is_directory(layout.version(id))) {
    return Status(ErrorCode::kNotFound, layout.root.string() + ": no version " + id +
                                            " is installed; see panofix-runtime list --store");
  }
  auto manifest = ReadSignedManifest(layout.version(id), keys->ring);
  if (manifest.ok() && manifest->id != id) {
    return Status(ErrorCode::kChecksumMismatch, layout.version(id).string() +
                                                    ": holds another bundle; mend it with "
                                                    "panofix-runtime fsck --repair");
  }
  return manifest;
}

Result<std::vector<StoreVersion>> ListVersions(const StoreLayout& layout) {
  std::vector<StoreVersion> versions;
  // To know what a version is that cannot be used.
  std::vector<KeyRing> rings(1);
  if (auto keys = ReadStoreKeys(layout); keys.ok()) {
    keys->ring.revoked.clear();
    rings.insert(rings.begin(), keys->ring);
  }
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(layout.versions(), error)) {
    StoreVersion version;
    version.id = entry.path().filename().string();
    if (!IsSha256(version.id)) continue;
    auto manifest = ReadVersion(layout, version.id);
    version.status = manifest.status();
    version.manifest.manifest.build = -1;
    for (auto ring = rings.begin(); !manifest.ok() && ring != rings.end(); ++ring)
      manifest = ReadSignedManifest(layout.version(version.id), *ring);
    version.is_known = manifest.ok() && manifest->id == version.id;
    if (version.is_known) version.manifest = std::move(*manifest);
    versions.push_back(std::move(version));
  }
  if (error) {
    return Status(ErrorCode::kNotFound, layout.root.string() + ": is no store (" + error.message() +
                                            "); make one with panofix-runtime init --store");
  }
  std::sort(versions.begin(), versions.end(), [](const auto& a, const auto& b) {
    return std::tuple(a.status.ok(), a.manifest.manifest.build, a.id) <
           std::tuple(b.status.ok(), b.manifest.manifest.build, b.id);
  });
  return versions;
}

void RaiseFloors(const std::vector<StoreVersion>& versions, StoreState* state) {
  for (const StoreVersion& v : versions) {
    if (!v.is_known || !v.manifest.release) continue;
    state->time_floor_s = std::max(state->time_floor_s, v.manifest.release->statement.created_s);
    if (v.manifest.manifest.build <= state->highest_build) continue;
    state->highest_build = v.manifest.manifest.build, state->highest_id = v.id;
  }
}

Result<std::vector<std::string>> RunnableVersions(const StoreLayout& layout) {
  const auto config = ReadStoreConfig(layout);
  if (!config.ok()) return config.status();
  const auto versions = ListVersions(layout);
  if (!versions.ok()) return versions.status();
  const auto state = ReadStoreState(layout);
  if (!state.ok()) LogWarning(state.status().message());
  std::vector<std::string> order, out;
  std::set<std::string> seen;
  if (state.ok()) order = {state->active, state->previous};
  for (auto v = versions->rbegin(); v != versions->rend(); ++v) order.push_back(v->id);
  Status last{ErrorCode::kNotFound,
              layout.root.string() + ": holds no map; install one with panofix-runtime install"};
  for (const std::string& id : order) {
    const auto v = std::find_if(versions->begin(), versions->end(),
                                [&](const StoreVersion& version) { return version.id == id; });
    if (v == versions->end() || !seen.insert(id).second) continue;
    Status status = v->status;
    if (status.ok()) status = CheckMeantForUs(v->manifest.manifest, *config);
    if (!status.ok()) {
      LogWarning(Format("version %.12s is not used: ", id.c_str()) + status.message());
      if (out.empty()) last = status;
      continue;
    }
    out.push_back(id);
  }
  if (out.empty()) return last;
  return out;
}

}  // namespace panofix
