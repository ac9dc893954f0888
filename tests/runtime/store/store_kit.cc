#include "tests/runtime/store/store_kit.h"

#include "common/io/sha256.h"
#include "common/map/map_bundle.h"
#include "common/package/delta_index.h"
#include "common/package/tar_header.h"

namespace panofix {

namespace fs = std::filesystem;

CraftedBundle BundleOfBuild(std::int64_t build) {
  CraftedBundle b = SmallBundle();
  b.manifest.name = kMapName;
  b.manifest.build = build;
  b.tiles[1].points[0] = static_cast<float>(build);
  b.scales[0] = 1 + 1e-6 * static_cast<double>(build % 100);
  return b;
}

std::string PackageBytes(const Entries& entries) {
  std::string bytes;
  const auto add = [&](const TarBlock& block) { bytes.append(block.begin(), block.end()); };
  for (const auto& [name, content] : entries) {
    add(EncodeTarHeader({name, content.size()}));
    bytes += content + std::string(TarPadding(content.size()), '\0');
  }
  add({}), add({});
  return bytes;
}

Entries EntriesOf(const fs::path& bundle) {
  const std::string text = ReadText(bundle / kManifestName);
  DeltaIndex index;
  index.target = Sha256Hex(text);
  Entries entries{{kDeltaIndexName, ToJson(index)},
                  {kManifestName, text},
                  {kManifestSignatureName, ReadText(bundle / kManifestSignatureName)}};
  const Manifest manifest = ParseManifest(text, "m").value();
  for (const BundlePart& part : manifest.parts)
    entries.emplace_back(ObjectEntryName(part.sha256), ReadText(bundle / part.path));
  return entries;
}

StoreKit::StoreKit() {
  const Status made = InitStore(layout_, {kMapName, SmallBundle().manifest.camera}, signer_.ring());
  EXPECT_TRUE(made.ok()) << made.message();
}

fs::path StoreKit::Bundle(std::int64_t build) {
  const fs::path path = folder_ / ("bundle-" + std::to_string(build));
  if (fs::exists(path)) return path;
  return BundleWith(path.filename(), build, [](CraftedBundle*) {});
}

fs::path StoreKit::BundleWith(const std::string& name, std::int64_t build,
                              const std::function<void(CraftedBundle*)>& change,
                              const std::function<void(ReleaseStatement*)>& change_statement) {
  const fs::path path = folder_ / name;
  CraftedBundle bundle = BundleOfBuild(build);
  change(&bundle);
  bundle.Write(path);
  SignFolder(path, signer_, change_statement);
  return path;
}

Result<InstallReport> StoreKit::InstallFolder(const fs::path& folder,
                                              const InstallOptions& options) const {
  return Install(layout_, *MakeFolderSource(folder), options);
}

Result<InstallReport> StoreKit::InstallPackage(const std::string& bytes) const {
  WriteText(folder_ / "package.pfb", bytes);
  return Install(layout_, *MakePackageSource(folder_ / "package.pfb"), {});
}

Status StoreKit::ActivateHere(const std::string& id) const {
  return Activate(layout_, id, OpeningProbe(layout_));
}

std::string StoreKit::Run(std::int64_t build) {
  const auto report = InstallFolder(Bundle(build));
  EXPECT_TRUE(report.ok()) << report.status().message();
  const Status active = ActivateHere(report.ok() ? report->id : "");
  EXPECT_TRUE(active.ok()) << active.message();
  return report.ok() ? report->id : "";
}

std::int64_t StoreKit::BuildInForce() const {
  return RunnableVersions(layout_).ok() ? OpenedBuild(layout_) : -1;
}

std::string StoreKit::IdOf(const fs::path& bundle) const {
  return Sha256Hex(ReadText(bundle / kManifestName));
}

HealthProbe OpeningProbe(const StoreLayout& layout) {
  return [=](const fs::path& folder) {
    return MapBundle::Open(folder, ValueOrThrow(ReadStoreKeys(layout)).ring).status();
  };
}

std::int64_t OpenedBuild(const StoreLayout& layout) {
  const auto versions = RunnableVersions(layout);
  if (!versions.ok()) {
    ADD_FAILURE() << versions.status().message();
    return -1;
  }
  const auto keys = ReadStoreKeys(layout);
  const auto bundle = MapBundle::Open(layout.version(versions->front()), keys.value().ring);
  if (!bundle.ok()) {
    ADD_FAILURE() << bundle.status().message();
    return -1;
  }
  return (*bundle)->manifest().build;
}

}  // namespace panofix
