#include "builder/ship/package.h"

#include <map>
#include <set>

#include "builder/ship/package_writer.h"
#include "builder/ship/patch.h"
#include "common/base/log.h"
#include "common/base/status.h"
#include "common/io/mapped_file.h"
#include "common/io/read_file.h"
#include "common/map/bundle_files.h"
#include "common/package/delta_index.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxKeyBytes = 4096;

// Which objects a bundle has, and which at each path.
struct Parts {
  std::set<std::string> objects;
  std::map<std::string, std::string> at_path;
};

Parts PartsOf(const Manifest& manifest) {
  Parts parts;
  for (const BundlePart& part : manifest.parts) {
    parts.objects.insert(part.sha256);
    parts.at_path.emplace(part.path, part.sha256);
  }
  return parts;
}

std::span<const std::uint8_t> Bytes(const MappedFile& file, const fs::path& path) {
  if (file.is_open()) return file.bytes();
  throw Error(ErrorCode::kIo, path.string() + ": cannot be read; check the disk");
}

// No vehicle would take another map, or an older one, in place of what it has.
void CheckLeadsOn(const Manifest& from, const Manifest& to) {
  if (from.name != to.name) {
    throw Error(ErrorCode::kWrongMap, "delta: the old bundle is of map '" + from.name +
                                          "', the new one of '" + to.name +
                                          "'; name two builds of one map");
  }
  if (to.build < from.build) {
    throw Error(
        ErrorCode::kDowngrade,
        Format("delta: the old bundle is build %lld, the new one build %lld, which vehicles "
               "refuse; name the older one first",
               static_cast<long long>(from.build), static_cast<long long>(to.build)));
  }
}

void AddKey(const fs::path& path, PackageWriter* writer) {
  const std::string text = ValueOrThrow(ReadFileText(path, kMaxKeyBytes));
  const PublicKey key = ValueOrThrow(ParsePublicKey(text, path.string()));
  const fs::path beside = path.string() + kSignatureSuffix;
  const std::string signature = ValueOrThrow(ReadFileText(beside, kMaxSignatureBytes));
  ThrowIfError(ParseSignature(signature, beside.string()).status());
  const std::string name = KeyEntryName(KeyIdText(key.id));
  writer->Add(name, text);
  writer->Add(name + kSignatureSuffix, signature);
}

}  // namespace

PackageReport WritePackage(const fs::path& base, const fs::path& target,
                           const std::vector<fs::path>& endorsed_keys, const fs::path& out) {
  const SignedManifest bundle = ValueOrThrow(VerifyBundle(target, {})).manifest;
  if (bundle.signature_text.empty()) {
    throw Error(ErrorCode::kUntrusted,
                target.string() + ": is not signed; sign it first with panofix-builder sign");
  }
  DeltaIndex index;
  index.target = bundle.id;
  Parts old;
  if (!base.empty()) {
    const SignedManifest before = ValueOrThrow(VerifyBundle(base, {})).manifest;
    CheckLeadsOn(before.manifest, bundle.manifest);
    index.base = before.id;
    old = PartsOf(before.manifest);
  }
  PackageReport report;
  report.num_parts = bundle.manifest.parts.size();
  PackageWriter payload(out), package(out);
  std::set<std::string> done;
  for (const BundlePart& part : bundle.manifest.parts) {
    report.num_bundle_bytes += part.num_bytes;
    if (old.objects.contains(part.sha256) || !done.insert(part.sha256).second) continue;
    const fs::path path = target / part.path;
    const MappedFile file(path, ~std::uint64_t{0});
    const auto before = old.at_path.find(part.path);
    if (before != old.at_path.end()) {
      const MappedFile old_file(base / part.path, ~std::uint64_t{0});
      const auto patch = MakePatch(Bytes(old_file, base / part.path), Bytes(file, path));
      if (!patch.empty()) {
        payload.Add(PatchEntryName(part.sha256), patch);
        index.patches.emplace(part.sha256, before->second);
        ++report.num_patches;
        continue;
      }
    }
    payload.Add(ObjectEntryName(part.sha256), Bytes(file, path));
    ++report.num_objects;
  }
  package.Add(kDeltaIndexName, ToJson(index));
  for (const fs::path& key : endorsed_keys) AddKey(key, &package);
  package.Add(kManifestName, bundle.text);
  package.Add(kManifestSignatureName, bundle.signature_text);
  package.Append(payload);
  package.Publish();
  report.num_package_bytes = package.num_bytes();
  return report;
}

}  // namespace panofix
