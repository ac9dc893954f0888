#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <set>

#include "common/io/atomic_file.h"
#include "runtime/store/upkeep.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

bool IsInUse(const fs::path& folder) {
  const UniqueFd fd(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  return fd.valid() && ::flock(fd.get(), LOCK_EX | LOCK_NB) != 0;
}

Status RemoveVersion(const StoreLayout& layout, const std::string& id) {
  // Out of sight by one rename: half a version is never seen.
  const fs::path gone = layout.staging() / ("removed-" + id);
  std::error_code error;
  fs::remove_all(gone, error);
  fs::rename(layout.version(id), gone, error);
  if (!error) fs::remove_all(gone, error);
  if (!error) return SyncPath(layout.versions());
  return {ErrorCode::kIo, layout.version(id).string() + ": cannot be removed (" + error.message() +
                              "); check the store's rights"};
}

void RemoveObjects(const StoreLayout& layout, const std::set<std::string>& used,
                   GarbageReport* report) {
  std::error_code error;
  std::vector<fs::path> unused;
  for (const auto& entry : fs::recursive_directory_iterator(layout.objects(), error)) {
    if (entry.is_directory(error)) continue;
    if (!used.contains(entry.path().filename().string())) unused.push_back(entry.path());
  }
  for (const fs::path& path : unused) {
    const std::uintmax_t num_bytes = fs::file_size(path, error);
    if (fs::remove(path, error)) {
      ++report->num_removed_objects;
      report->num_freed_bytes += num_bytes;
    }
  }
}

// No way back leads to what a revoked key signed.
Status ForgetRevoked(const StoreLayout& layout, const std::vector<StoreVersion>& versions,
                     StoreState* state) {
  bool changed = false;
  for (std::string* id : {&state->previous, &state->before_previous}) {
    const auto v = std::find_if(versions.begin(), versions.end(),
                                [&](const StoreVersion& version) { return version.id == *id; });
    if (v == versions.end() || !v->is_revoked()) continue;
    id->clear();
    changed = true;
  }
  return changed ? WriteStoreState(layout, *state) : Status();
}

}  // namespace

Result<VersionHold> VersionHold::Take(const StoreLayout& layout, const std::string& id) {
  VersionHold hold;
  const fs::path folder = layout.version(id);
  hold.fd_ = UniqueFd(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!hold.fd_.valid() || ::flock(hold.fd_.get(), LOCK_SH | LOCK_NB) != 0) {
    return Status(ErrorCode::kTryAgain,
                  folder.string() + ": cannot be held (" + std::strerror(errno) + "); run again");
  }
  return hold;
}

Result<GarbageReport> CollectGarbage(const StoreLayout& layout) {
  const auto lock = StoreLock::Take(layout);
  if (!lock.ok()) return lock.status();
  auto state = ReadStoreState(layout);
  if (!state.ok()) return state.status();
  const auto versions = ListVersions(layout);
  if (!versions.ok()) return versions.status();
  const Status forgotten = ForgetRevoked(layout, *versions, &*state);
  if (!forgotten.ok()) return forgotten;
  GarbageReport report;
  std::set<std::string> used;
  for (const StoreVersion& v : *versions) {
    const bool is_newest = &v == &versions->back() && !v.is_revoked();
    const bool is_kept = v.id == state->active || v.id == state->previous ||
                         v.id == state->before_previous || is_newest ||
                         IsInUse(layout.version(v.id));
    if (!is_kept) {
      const Status removed = RemoveVersion(layout, v.id);
      if (!removed.ok()) return removed;
      report.removed_versions.push_back(v.id);
      continue;
    }
    if (!v.is_known) {
      // Which objects it uses cannot be told: it keeps them all.
      return Status(v.status.code(), v.status.message() +
                                         "; nothing more is removed until panofix-runtime fsck "
                                         "--repair has mended that");
    }
    for (const BundlePart& part : v.manifest.manifest.parts) used.insert(part.sha256);
  }
  RemoveObjects(layout, used, &report);
  std::error_code error;
  for (const fs::path& folder : {layout.staging(), layout.downloads()}) {
    fs::remove_all(folder, error);
    const Status made = MakeDirectories(folder, "--store");
    if (!made.ok()) return made;
  }
  return report;
}

}  // namespace panofix
