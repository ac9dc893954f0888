#include "runtime/store/install.h"

#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <set>

#include "common/base/log.h"
#include "common/io/atomic_file.h"
#include "common/sign/utc_time.h"
#include "runtime/store/acceptance.h"
#include "runtime/store/object_pool.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

// One install from start to end, under the store's lock.
class Installer {
 public:
  Installer(const StoreLayout& layout, BundleSource& source, const InstallOptions& options)
      : layout_(layout), source_(source), options_(options) {}
  Result<InstallReport> Run();

 private:
  Status ReadStore();
  Status Accept();
  Status TakeEndorsedKeys(const BundleOffer& offer);
  Status CheckNotRenewedSince() const;
  Status CheckSpace() const;
  Status Fetch();
  Status StageVersion(const fs::path& staged) const;
  Status Publish();

  const StoreLayout& layout_;
  BundleSource& source_;
  const InstallOptions& options_;
  StoreConfig config_;
  StoreState state_;
  StoreKeys keys_;
  bool has_new_keys_ = false;
  SignedManifest bundle_;
  std::map<std::string, std::uint64_t> lacking_;
  std::map<std::string, std::string> parts_;  // a path of each object
  InstallReport report_;
};

Status Installer::ReadStore() {
  auto config = ReadStoreConfig(layout_);
  if (!config.ok()) return config.status();
  auto state = ReadStoreState(layout_);
  if (!state.ok()) return state.status();
  auto keys = ReadStoreKeys(layout_);
  if (!keys.ok()) return keys.status();
  config_ = std::move(*config), state_ = std::move(*state), keys_ = std::move(*keys);
  // Were the state lost, what is installed would still say what was seen.
  const auto versions = ListVersions(layout_);
  if (!versions.ok()) return versions.status();
  RaiseFloors(*versions, &state_);
  return {};
}

Status Installer::TakeEndorsedKeys(const BundleOffer& offer) {
  for (const OfferedKey& offered : offer.keys) {
    const std::string name = source_.name() + ": endorsed key";
    auto key = ParsePublicKey(offered.key_text, name);
    if (!key.ok()) return key.status();
    const auto& trusted = keys_.ring.trusted;
    if (std::find(trusted.begin(), trusted.end(), *key) != trusted.end()) continue;
    key = VerifyEndorsement(keys_.ring, offered.key_text, offered.signature_text, name);
    if (!key.ok()) return key.status();
    const auto by = ParseSignature(offered.signature_text, name);
    keys_.ring.trusted.push_back(*key);
    keys_.endorsed_by.push_back(by.ok() ? KeyIdText(by->key_id) : "");
    has_new_keys_ = true;
  }
  return {};
}

Status Installer::Accept() {
  auto offer = source_.ReadOffer();
  if (!offer.ok()) return offer.status();
  Status status = TakeEndorsedKeys(*offer);
  if (!status.ok()) return status;
  auto bundle = CheckManifest(std::move(offer->manifest_text), std::move(offer->signature_text),
                              keys_.ring, source_.name());
  if (!bundle.ok()) return bundle.status();
  bundle_ = std::move(*bundle);
  status = CheckMeantForUs(bundle_.manifest, config_);
  if (status.ok()) status = CheckNotOlder(bundle_, state_);
  if (status.ok()) status = CheckExpiry(*bundle_.release, state_);
  if (status.ok()) status = CheckNotRenewedSince();
  if (!status.ok()) return {status.code(), source_.name() + ": " + status.message()};
  for (const BundlePart& part : bundle_.manifest.parts) {
    report_.num_bytes += part.num_bytes;
    if (part.num_bytes > options_.max_bytes || report_.num_bytes > options_.max_bytes) {
      return {ErrorCode::kEndlessData,
              Format("%s: states more than %llu bytes; give a larger --max-bytes if that is right",
                     source_.name().c_str(), static_cast<unsigned long long>(options_.max_bytes))};
    }
  }
  return {};
}

// The same bundle with an older signature would bring its expiry back.
Status Installer::CheckNotRenewedSince() const {
  const auto installed = ReadVersion(layout_, bundle_.id);
  if (!installed.ok() || !installed->release) return {};
  const std::int64_t here_s = installed->release->statement.created_s;
  if (bundle_.release->statement.created_s >= here_s) return {};
  return {ErrorCode::kDowngrade, "its signature is older than the one that is here, of " +
                                     FormatUtc(here_s) + "; get the renewed one"};
}

Status Installer::CheckSpace() const {
  struct statvfs info {};
  constexpr std::uint64_t kReserve = std::uint64_t{8} << 20;  // folders, manifest, state
  std::uint64_t needed = kReserve + bundle_.text.size();
  for (const auto& [sha256, num_bytes] : lacking_) needed += num_bytes;
  if (::statvfs(layout_.root.c_str(), &info) != 0) return {};  // writing will tell
  const std::uint64_t free = std::uint64_t{info.f_bavail} * info.f_frsize;
  if (free >= needed) return {};
  return {ErrorCode::kNoSpace,
          Format("%s: %llu MB free, %llu MB are needed; free space on this disk (panofix-runtime "
                 "gc) and run again",
                 layout_.root.c_str(), static_cast<unsigned long long>(free / 1000000),
                 static_cast<unsigned long long>(needed / 1000000))};
}

Status Installer::Fetch() {
  std::map<std::string, std::uint64_t> sizes;
  for (const BundlePart& part : bundle_.manifest.parts) {
    parts_.emplace(part.sha256, part.path);
    const auto [known, is_new] = sizes.emplace(part.sha256, part.num_bytes);
    if (!is_new && known->second != part.num_bytes) {
      return {ErrorCode::kBadData, source_.name() +
                                       ": states two sizes for one hash; sign a bundle "
                                       "that panofix-builder wrote"};
    }
  }
  for (const auto& [sha256, num_bytes] : sizes) {
    if (!HasGoodObject(layout_, sha256, num_bytes)) lacking_.emplace(sha256, num_bytes);
  }
  report_.num_parts = bundle_.manifest.parts.size();
  report_.num_new_parts = lacking_.size();
  for (const auto& [sha256, num_bytes] : lacking_) report_.num_new_bytes += num_bytes;
  Status status = CheckSpace();
  if (status.ok()) status = source_.Deliver(layout_, lacking_, parts_);
  if (!status.ok()) return status;
  for (const auto& [sha256, num_bytes] : lacking_) {
    std::error_code error;
    if (fs::file_size(layout_.object(sha256), error) == num_bytes && !error) continue;
    return {ErrorCode::kIncomplete, source_.name() + ": does not hold " + parts_.at(sha256) +
                                        ", which is not in this store either; fetch the whole "
                                        "bundle"};
  }
  return {};
}

// The version's folder: an ordinary bundle, its parts hard links to objects.
Status Installer::StageVersion(const fs::path& staged) const {
  std::error_code error;
  fs::remove_all(staged, error);
  std::set<fs::path> folders{staged};
  for (const BundlePart& part : bundle_.manifest.parts) {
    const fs::path path = staged / part.path;
    for (fs::path f = path.parent_path(); f != staged; f = f.parent_path()) folders.insert(f);
  }
  for (const fs::path& folder : folders) {  // a folder sorts before what it holds
    Status status = MakeDirectories(folder, "--store");
    if (!status.ok()) return status;
  }
  for (const BundlePart& part : bundle_.manifest.parts) {
    const fs::path path = staged / part.path;
    if (::link(layout_.object(part.sha256).c_str(), path.c_str()) != 0) {
      const bool is_full = errno == ENOSPC || errno == EDQUOT;
      return {is_full ? ErrorCode::kNoSpace : ErrorCode::kIo,
              path.string() + ": cannot be linked (" + std::strerror(errno) +
                  "); use a file system with hard links and space for the store"};
    }
  }
  Status status = WriteFileAtomically(staged / kManifestName, bundle_.text);
  if (status.ok()) {
    status =
        WriteFileAtomically(staged / kManifestHashName, bundle_.id + "  " + kManifestName + "\n");
  }
  if (status.ok())
    status = WriteFileAtomically(staged / kManifestSignatureName, bundle_.signature_text);
  for (auto folder = folders.rbegin(); status.ok() && folder != folders.rend(); ++folder)
    status = SyncPath(*folder);
  return status;
}

Status Installer::Publish() {
  const fs::path staged = layout_.staging() / ("version-" + bundle_.id);
  Status status = StageVersion(staged);
  // Before the version: it must verify from its first moment on.
  if (status.ok() && has_new_keys_) status = WriteStoreKeys(layout_, keys_);
  if (status.ok()) status = PublishDirectory(staged, layout_.version(bundle_.id));
  if (!status.ok()) return status;
  state_.time_floor_s = std::max(state_.time_floor_s, bundle_.release->statement.created_s);
  state_.highest_build = bundle_.manifest.build, state_.highest_id = bundle_.id;
  return WriteStoreState(layout_, state_);
}

Result<InstallReport> Installer::Run() {
  Status status = ReadStore();
  if (status.ok()) status = Accept();
  if (status.ok()) status = Fetch();
  if (status.ok()) status = Publish();
  if (!status.ok()) return status;
  report_.id = bundle_.id, report_.build = bundle_.manifest.build;
  return report_;
}

}  // namespace

Result<InstallReport> Install(const StoreLayout& layout, BundleSource& source,
                              const InstallOptions& options) {
  const auto lock = StoreLock::Take(layout);
  if (!lock.ok()) return lock.status();
  // A try that was cut off leaves a half object or version here; nothing refers to it.
  std::error_code error;
  fs::remove_all(layout.staging(), error);
  const Status made = MakeDirectories(layout.staging(), "--store");
  if (!made.ok()) return made;
  return Installer(layout, source, options).Run();
}

}  // namespace panofix
