#include "common/base/cancel.h"
#include "common/base/log.h"
#include "common/io/read_file.h"
#include "common/map/manifest.h"
#include "common/package/delta_index.h"
#include "runtime/store/bundle_source.h"
#include "runtime/store/object_pool.h"
#include "runtime/store/package_reader.h"
#include "runtime/store/patch_decoder.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxKeyBytes = 4096;
constexpr std::size_t kMaxKeys = 16;

class PackageSource : public BundleSource {
 public:
  explicit PackageSource(const fs::path& file) : file_(file), name_(file.string()) {}
  const std::string& name() const override { return name_; }
  Result<BundleOffer> ReadOffer() override;
  Status Deliver(const StoreLayout& layout, const std::map<std::string, std::uint64_t>& lacking,
                 const std::map<std::string, std::string>& parts) override;

 private:
  Status Bad(const std::string& fault) const {
    return {ErrorCode::kBadData,
            name_ + ": " + fault + "; get the package again, as panofix-builder wrote it"};
  }
  // The next entry's content, which must have this name.
  Result<std::string> Expect(const std::string& entry, std::size_t max_bytes);
  Status DeliverEntry(const StoreLayout& layout, const PackageEntry& entry,
                      const std::map<std::string, std::uint64_t>& lacking,
                      const std::map<std::string, std::string>& parts);

  const fs::path file_;
  const std::string name_;
  std::optional<PackageReader> reader_;
  DeltaIndex index_;
};

Result<std::string> PackageSource::Expect(const std::string& entry, std::size_t max_bytes) {
  const auto next = reader_->Next();
  if (!next.ok()) return next.status();
  if (!*next || (*next)->name != entry) return Bad(entry + " is not where it must be");
  return reader_->ReadAll(max_bytes);
}

Result<BundleOffer> PackageSource::ReadOffer() {
  auto opened = PackageReader::Open(file_);
  if (!opened.ok()) return opened.status();
  reader_.emplace(std::move(*opened));
  const auto index_text = Expect(kDeltaIndexName, kMaxDeltaIndexBytes);
  if (!index_text.ok()) return index_text.status();
  auto index = ParseDeltaIndex(*index_text, name_);
  if (!index.ok()) return index.status();
  index_ = std::move(*index);
  BundleOffer offer;
  while (true) {
    const auto next = reader_->Next();
    if (!next.ok()) return next.status();
    if (!*next) return Bad("it has no manifest");
    if ((*next)->name == kManifestName) break;
    if (offer.keys.size() >= kMaxKeys) return Bad("more keys than are read");
    auto key = reader_->ReadAll(kMaxKeyBytes);
    if (!key.ok()) return key.status();
    auto signature = Expect((*next)->name + kSignatureSuffix, kMaxSignatureBytes);
    if (!signature.ok()) return signature.status();
    offer.keys.push_back({std::move(*key), std::move(*signature)});
  }
  auto manifest = reader_->ReadAll(kMaxManifestBytes);
  if (!manifest.ok()) return manifest.status();
  offer.manifest_text = std::move(*manifest);
  auto signature = Expect(kManifestSignatureName, kMaxSignatureBytes);
  if (!signature.ok()) return signature.status();
  offer.signature_text = std::move(*signature);
  if (Sha256Hex(offer.manifest_text) != index_.target)
    return Bad("its manifest is not that of the bundle that it says to hold");
  return offer;
}

Status PackageSource::DeliverEntry(const StoreLayout& layout, const PackageEntry& entry,
                                   const std::map<std::string, std::uint64_t>& lacking,
                                   const std::map<std::string, std::string>& parts) {
  const bool is_patch = entry.name.starts_with("patches/");
  if (!is_patch && !entry.name.starts_with("objects/")) return Bad(entry.name + " comes too late");
  const std::string sha256 = entry.name.substr(8, 64);
  if (!parts.contains(sha256)) {
    return {ErrorCode::kMixedParts, name_ + ": object " + sha256.substr(0, 12) +
                                        " is not in the signed manifest; fetch the package again"};
  }
  const auto wanted = lacking.find(sha256);
  if (wanted == lacking.end()) return {};  // is here already; or an earlier try brought it
  auto writer = ObjectWriter::Begin(layout, sha256, wanted->second);
  if (!writer.ok()) return writer.status();
  Status status;
  if (is_patch) {
    const auto patch = index_.patches.find(sha256);
    if (patch == index_.patches.end()) return Bad("delta.json does not say what a patch is for");
    status = ApplyPatch(
        layout, patch->second, wanted->second,
        [this](std::span<std::uint8_t> buffer) { return reader_->Read(buffer); }, writer->get());
  } else {
    std::vector<std::uint8_t> block(std::size_t{1} << 20);
    while (status.ok()) {
      if (CancelRequested())
        return {ErrorCode::kCancelled, "stopped by the user; run it again to go on"};
      const auto got = reader_->Read(block);
      if (!got.ok()) return got.status();
      if (*got == 0) break;
      status = (*writer)->Write(std::span(block).first(*got));
    }
  }
  if (status.ok()) status = (*writer)->Commit();
  if (status.ok()) return {};
  return {status.code(), name_ + ": " + parts.at(sha256) + ": " + status.message()};
}

Status PackageSource::Deliver(const StoreLayout& layout,
                              const std::map<std::string, std::uint64_t>& lacking,
                              const std::map<std::string, std::string>& parts) {
  while (true) {
    const auto next = reader_->Next();
    if (!next.ok()) return next.status();
    if (!*next) return {};
    const Status status = DeliverEntry(layout, **next, lacking, parts);
    if (!status.ok()) return status;
  }
}

}  // namespace

std::unique_ptr<BundleSource> MakePackageSource(const fs::path& file) {
  return std::make_unique<PackageSource>(file);
}

}  // namespace panofix
