#include <fcntl.h>
#include <unistd.h>

#include <algorithm>

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
  bool MendVersion(const StoreVersion& version);
  Status CheckState();
  void Fault(const std::string& line) { report_.faults.push_back(line); }
  void Repaired(const std::string& line) { report_.repairs.push_back(line); }

  const StoreLayout& layout_;
  const bool repair_;
  KeyRing ring_;
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

// Links parts that are damaged or missing anew from good objects, and the other way round.
bool Checker::MendVersion(const StoreVersion& version) {
  if (!version.status.ok()) return false;
  std::error_code error;
  for (const BundlePart& part : version.manifest.manifest.parts) {
    const fs::path path = layout_.version(version.id) / part.path;
    const fs::path object = layout_.object(part.sha256);
    const auto hash = Sha256OfFile(path);
    const bool is_good = hash.ok() && *hash == part.sha256;
    const bool has_object = HasGoodObject(layout_, part.sha256, part.num_bytes);
    if (is_good && has_object) continue;
    if (!is_good && !has_object) return false;
    const fs::path& from = is_good ? path : object;
    const fs::path& to = is_good ? object : path;
    fs::create_directories(to.parent_path(), error);
    fs::remove(to, error);
    if (::link(from.c_str(), to.c_str()) != 0) return false;
    Repaired(to.string() + ": linked anew");
  }
  return VerifyBundle(layout_.version(version.id), ring_).ok();
}

void Checker::CheckVersions() {
  const auto versions = ListVersions(layout_);
  if (!versions.ok()) return Fault(versions.status().message());
  report_.num_versions = versions->size();
  for (const StoreVersion& version : *versions) {
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
      std::error_code error;
      fs::rename(layout_.version(version.id), layout_.staging() / ("removed-" + version.id), error);
      if (!error) Repaired("version " + version.id + ": removed, install it again");
    }
  }
}

Status Checker::CheckState() {
  const auto read = ReadStoreState(layout_);
  StoreState state = read.ok() ? *read : StoreState{};
  const auto is_whole = [&](const std::string& id) {
    return std::find(whole_.begin(), whole_.end(), id) != whole_.end();
  };
  bool changed = !read.ok();
  if (!read.ok()) Fault(read.status().message());
  if (!state.previous.empty() && !is_whole(state.previous)) {
    Fault("the version before the active one is not whole");
    state.previous.clear();
    changed = true;
  }
  const bool lost_active =
      read.ok() ? !state.active.empty() && !is_whole(state.active) : !whole_.empty();
  if (lost_active) {
    if (read.ok()) Fault("the active version is not whole");
    state.active = !state.previous.empty() ? state.previous : whole_.empty() ? "" : whole_.back();
    state.is_proven = false;
    if (state.previous == state.active) state.previous.clear();
    changed = true;
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
  CheckObjects();
  CheckVersions();
  const Status status = CheckState();
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
