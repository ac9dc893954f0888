#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <utility>

#include "common/base/log.h"
#include "common/io/atomic_file.h"
#include "common/io/sha256.h"
#include "runtime/store/acceptance.h"
#include "runtime/store/object_pool.h"
#include "runtime/store/upkeep.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

class Checker {
 public:
  Checker(const StoreLayout& layout, bool repair) : layout_(layout), repair_(repair) {}
  Result<CheckReport> Run();

 private:
  void CheckObjects();
  void CheckVersions();
  [[nodiscard]] bool IsGoodPart(const StoreVersion& version, const BundlePart& part) const;
  bool LinkAnew(const fs::path& from, const fs::path& to);
  void RestoreObjects();
  bool MendVersion(const StoreVersion& version);
  void RemoveVersion(const StoreVersion& version);
  [[nodiscard]] std::string WhatToInstall() const;
  bool Holds(const std::string& id, const std::string& what, bool revoked_is_fault);
  Status CheckState(const Result<StoreState>& read);
  void Fault(const std::string& line) { report_.faults.push_back(line); }
  void Repaired(const std::string& line) { report_.repairs.push_back(line); }

  const StoreLayout& layout_;
  const bool repair_;
  KeyRing ring_;
  std::vector<StoreVersion> versions_;
  StoreState floors_;               // what the state, or else what is installed, says was seen here
  std::vector<std::string> whole_;  // versions that are, oldest build first
  CheckReport report_;
};

void Checker::CheckObjects() {
  std::error_code error;
  std::vector<fs::path> objects;
  for (const auto& entry : fs::recursive_directory_iterator(layout_.objects(), error)) {
    if (!entry.is_directory(error)) objects.push_back(entry.path());
  }
  std::sort(objects.begin(), objects.end());
  report_.num_objects = objects.size();
  for (const fs::path& path : objects) {
    const std::string name = path.filename().string();
    const auto hash = Sha256OfFile(path);
    if (hash.ok() && *hash == name && path == layout_.object(name)) continue;
    Fault(path.string() + ": damaged, or no object");
    if (repair_ && fs::remove(path, error)) Repaired(path.string() + ": removed");
  }
}

bool Checker::IsGoodPart(const StoreVersion& version, const BundlePart& part) const {
  const auto hash = Sha256OfFile(layout_.version(version.id) / part.path);
  return hash.ok() && *hash == part.sha256;
}

bool Checker::LinkAnew(const fs::path& from, const fs::path& to) {
  std::error_code error;
  fs::create_directories(to.parent_path(), error);
  fs::remove(to, error);
  if (::link(from.c_str(), to.c_str()) != 0) return false;
  Repaired(to.string() + ": linked anew");
  return true;
}

// Objects from any version that has them whole: one good copy mends all versions.
void Checker::RestoreObjects() {
  for (const StoreVersion& version : versions_) {
    for (const BundlePart& part : version.manifest.manifest.parts) {
      // A damaged one is gone by now.
      if (!fs::exists(layout_.object(part.sha256)) && IsGoodPart(version, part))
        LinkAnew(layout_.version(version.id) / part.path, layout_.object(part.sha256));
    }
  }
}

bool Checker::MendVersion(const StoreVersion& version) {
  if (!version.status.ok()) return false;
  for (const BundlePart& part : version.manifest.manifest.parts) {
    const fs::path object = layout_.object(part.sha256);
    if (!HasGoodObject(layout_, part.sha256, part.num_bytes)) return false;
    if (IsGoodPart(version, part)) continue;
    if (!LinkAnew(object, layout_.version(version.id) / part.path)) return false;
  }
  return VerifyBundle(layout_.version(version.id), ring_).ok();
}

void Checker::RemoveVersion(const StoreVersion& version) {
  std::error_code error;
  fs::rename(layout_.version(version.id), layout_.staging() / ("removed-" + version.id), error);
  if (error) return;
  const std::string build =
      version.is_known
          ? Format(" (build %lld)", static_cast<long long>(version.manifest.manifest.build))
          : "";
  Repaired("version " + version.id + build + ": removed, its good parts are kept; " +
           (version.id == floors_.highest_id ? "install it again" : WhatToInstall()));
}

std::string Checker::WhatToInstall() const {
  if (floors_.highest_id.empty()) return "install a map with panofix-runtime install";
  return Format("install build %lld (%.12s) or a newer one, signed with a trusted key",
                static_cast<long long>(floors_.highest_build), floors_.highest_id.c_str());
}

void Checker::CheckVersions() {
  report_.num_versions = versions_.size();
  if (repair_) RestoreObjects();
  for (const StoreVersion& version : versions_) {
    if (version.is_revoked()) continue;
    Status status = version.status;
    if (status.ok()) status = VerifyBundle(layout_.version(version.id), ring_).status();
    for (std::size_t i = 0; status.ok() && i < version.manifest.manifest.parts.size(); ++i) {
      const BundlePart& part = version.manifest.manifest.parts[i];
      if (!fs::exists(layout_.object(part.sha256)))
        status = {ErrorCode::kIncomplete, layout_.object(part.sha256).string() + ": is missing"};
    }
    if (!status.ok()) Fault(status.message());
    if (status.ok() || (repair_ && MendVersion(version))) {
      whole_.push_back(version.id);
    } else if (repair_) {
      RemoveVersion(version);
    }
  }
}

// Whether the state may name this version; a fault where it names one that is not whole.
bool Checker::Holds(const std::string& id, const std::string& what, bool revoked_is_fault) {
  if (id.empty() || std::find(whole_.begin(), whole_.end(), id) != whole_.end()) return true;
  const bool is_revoked =
      std::any_of(versions_.begin(), versions_.end(),
                  [&](const StoreVersion& v) { return v.id == id && v.is_revoked(); });
  if (!is_revoked) {
    Fault(what + " is not whole");
  } else if (revoked_is_fault) {
    Fault(what + " is signed with a revoked key, and is not served");
  }
  return false;
}

Status Checker::CheckState(const Result<StoreState>& read) {
  StoreState state = read.ok() ? *read : floors_;
  bool changed = !read.ok();
  if (!read.ok()) Fault(read.status().message());
  if (!Holds(state.before_previous, "the version before an unproven one", false))
    state.before_previous.clear(), changed = true;
  if (!Holds(state.previous, "the version before the active one", false)) {
    state.previous = std::exchange(state.before_previous, "");
    changed = true;
  }
  if (!read.ok() || !Holds(state.active, "the active version", true)) {
    state.active = !state.previous.empty() ? state.previous : whole_.empty() ? "" : whole_.back();
    state.previous = std::exchange(state.before_previous, "");
    state.is_proven = false;
    changed = true;
    if (state.active.empty()) {
      report_.in_force = {ErrorCode::kNotFound,
                          layout_.root.string() + ": no map is in force; " + WhatToInstall()};
    }
  }
  if (!changed || !repair_) return {};
  Repaired("active is now " + (state.active.empty() ? "nothing" : state.active));
  return WriteStoreState(layout_, state);
}

Result<CheckReport> Checker::Run() {
  const auto config = ReadStoreConfig(layout_);
  if (!config.ok()) return config.status();
  const auto keys = ReadStoreKeys(layout_);
  if (!keys.ok()) return keys.status();
  ring_ = keys->ring;
  if (repair_) {
    std::error_code error;
    fs::remove_all(layout_.staging(), error);
    for (const fs::path& folder : {layout_.staging(), layout_.objects(), layout_.versions()}) {
      const Status made = MakeDirectories(folder, "--store");
      if (!made.ok()) return made;
    }
  }
  // Before anything goes: also what is damaged tells what was seen here.
  auto versions = ListVersions(layout_);
  if (!versions.ok()) return versions.status();
  versions_ = std::move(*versions);
  const auto state = ReadStoreState(layout_);
  if (state.ok()) {
    floors_.highest_build = state->highest_build, floors_.highest_id = state->highest_id;
    floors_.time_floor_s = state->time_floor_s;
  }
  RaiseFloors(versions_, &floors_);
  CheckObjects();
  CheckVersions();
  const Status status = CheckState(state);
  if (!status.ok()) return status;
  return report_;
}

}  // namespace

Result<CheckReport> CheckStore(const StoreLayout& layout, bool repair) {
  const auto lock = StoreLock::Take(layout);
  if (!lock.ok()) return lock.status();
  return Checker(layout, repair).Run();
}

}  // namespace panofix
