// A .pfb package into a store that has one map: whatever comes, the store holds nothing but signed
// bundles, and nothing outside it is written.

#include <cstdlib>
#include <set>

#include "common/io/sha256.h"
#include "common/package/delta_index.h"
#include "common/package/tar_header.h"
#include "runtime/store/upkeep.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/runtime/store/store_kit.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

// Made with zstd --patch-from: kOldTile to kNewTile.
constexpr char kOldTile[] = "the old tile, the old tile, the old tile, and then the end of it";
constexpr char kNewTile[] = "the old tile, the old tile, the new tile, and then the end of it";
constexpr std::uint8_t kPatch[] = {0x28, 0xb5, 0x2f, 0xfd, 0x20, 0x40, 0x85, 0x00, 0x00,
                                   0x18, 0x6e, 0x65, 0x77, 0x04, 0x00, 0x43, 0x50, 0x00,
                                   0xe4, 0xfc, 0xb4, 0xa0, 0x32, 0x0a, 0x08};

struct Release {
  Manifest manifest;
  std::string text, signature;
};

// A bundle of one small part beside what all share. Nobody opens it: parts may hold anything.
Release MakeRelease(std::int64_t build, const std::string& tile, const TestSigner& signer) {
  Release release;
  release.manifest = SmallBundle().manifest;
  release.manifest.name = kMapName;
  release.manifest.build = build;
  release.manifest.parts = {{"graph.h5", 5, Sha256Hex("graph")},
                            {"tiles/1.h5", tile.size(), Sha256Hex(tile)}};
  release.text = ToJson(release.manifest);
  release.signature =
      signer.Sign(release.text, FormatStatement(StatementFor(release.manifest)).value());
  return release;
}

// The sandbox: a store with build 1, a package beside it, nothing else.
struct Sandbox {
  TempFolder folder;
  StoreLayout layout{folder / "store"};
  TestSigner signer{1}, other{2};
  Release one = MakeRelease(1, kOldTile, signer), two = MakeRelease(2, kNewTile, signer);

  Sandbox() { Reset(); }
  void Reset() {
    fs::remove_all(layout.root);
    ThrowIfError(InitStore(layout, {kMapName, SmallBundle().manifest.camera}, signer.ring()));
    WriteText(folder / "one" / kManifestName, one.text);
    WriteText(folder / "one" / kManifestSignatureName, one.signature);
    WriteText(folder / "one" / "graph.h5", "graph");
    WriteText(folder / "one" / "tiles/1.h5", kOldTile);
    ThrowIfError(Install(layout, *MakeFolderSource(folder / "one"), {}).status());
    fs::remove_all(folder / "one");
  }
  void RequireNothingElse() const {
    for (const auto& entry : fs::directory_iterator(folder.path())) {
      const std::string name = entry.path().filename();
      if (name != "store" && name != "p.pfb") std::abort();
    }
    static const std::set<std::string> known{"store.json", "state.json", "keys.json", "lock",
                                             "objects",    "versions",   "staging",   "downloads"};
    for (const auto& entry : fs::directory_iterator(layout.root)) {
      if (!known.contains(entry.path().filename()) || entry.is_symlink()) std::abort();
    }
    for (const auto& entry : fs::directory_iterator(layout.versions())) {
      const std::string id = entry.path().filename();
      if (id != Sha256Hex(one.text) && id != Sha256Hex(two.text)) std::abort();
      if (!VerifyBundle(entry.path(), signer.ring()).ok()) std::abort();
    }
  }
};

Sandbox& Box() {
  static Sandbox box;
  return box;
}

std::string Header(const std::string& name, std::uint64_t size) {
  const TarBlock block = EncodeTarHeader({name, size});
  return {block.begin(), block.end()};
}

}  // namespace

FuzzCorpus SeedCorpus() {
  const Release& two = Box().two;
  const std::string patch(reinterpret_cast<const char*>(kPatch), sizeof kPatch);
  const std::string tile = Sha256Hex(kNewTile), old_tile = Sha256Hex(kOldTile);
  const DeltaIndex whole{"", Sha256Hex(two.text), {}};
  const DeltaIndex delta{Sha256Hex(Box().one.text), Sha256Hex(two.text), {{tile, old_tile}}};
  const std::string key_name = KeyEntryName(Box().other.id());
  const Entries head{{kManifestName, two.text}, {kManifestSignatureName, two.signature}};
  const auto package = [&](const DeltaIndex& index, Entries entries) {
    entries.insert(entries.begin(), head.begin(), head.end());
    entries.insert(entries.begin(), {kDeltaIndexName, ToJson(index)});
    return entries;
  };
  Entries with_key = package(whole, {{ObjectEntryName(tile), kNewTile}});
  with_key.insert(with_key.begin() + 1,
                  {key_name + kSignatureSuffix, Box().signer.Endorse(Box().other.key())});
  with_key.insert(with_key.begin() + 1, {key_name, FormatPublicKey(Box().other.key())});
  FuzzCorpus corpus;
  corpus.inputs = {PackageBytes(package(whole, {{ObjectEntryName(tile), kNewTile}})),
                   PackageBytes(package(delta, {{PatchEntryName(tile), patch}})),
                   PackageBytes(with_key)};
  // Mutations start from packages that are right.
  for (const std::string& input : corpus.inputs) {
    WriteText(Box().folder / "p.pfb", input);
    ThrowIfError(Install(Box().layout, *MakePackageSource(Box().folder / "p.pfb"), {}).status());
    Box().Reset();
  }
  corpus.words = {Header(ObjectEntryName(tile), 64),
                  Header(ObjectEntryName(Sha256Hex("graph")), 5),
                  Header(PatchEntryName(tile), patch.size()),
                  Header(PatchEntryName(tile), kMaxEntryBytes),
                  Header(kManifestName, two.text.size()),
                  Header(key_name, 100),
                  std::string(512, '\0'),
                  std::string("../../"),
                  std::string("/etc/"),
                  patch,
                  std::string("\x28\xB5\x2F\xFD", 4)};
  return corpus;
}

}  // namespace panofix

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace panofix;
  Sandbox& box = Box();
  WriteText(box.folder / "p.pfb", {reinterpret_cast<const char*>(data), size});
  const auto report = Install(box.layout, *MakePackageSource(box.folder / "p.pfb"), {});
  if (!report.ok() && report.status().message().empty()) std::abort();
  const bool has_new_key = ReadStoreKeys(box.layout).value().ring.trusted.size() != 1;
  // Only the real release gets in, whatever the package around it looks like.
  if (report.ok() && report->id != Sha256Hex(box.two.text)) std::abort();
  if (has_new_key && !report.ok()) std::abort();
  box.RequireNothingElse();
  if (report.ok()) box.Reset();
  return 0;
}
