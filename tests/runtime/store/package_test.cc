// Packages: what they bring, and what hostile ones cannot do.
#include <gtest/gtest.h>
#include <zstd.h>

#include "common/io/sha256.h"
#include "common/package/delta_index.h"
#include "common/package/tar_header.h"
#include "tests/runtime/store/store_kit.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

std::string Patch(const std::string& base, const std::string& target) {
  ZSTD_CCtx* context = ZSTD_createCCtx();
  ZSTD_CCtx_setParameter(context, ZSTD_c_windowLog, PatchWindowLog(base.size(), target.size()));
  ZSTD_CCtx_refPrefix(context, base.data(), base.size());
  std::string patch(ZSTD_compressBound(target.size()), '\0');
  patch.resize(ZSTD_compress2(context, patch.data(), patch.size(), target.data(), target.size()));
  ZSTD_freeCCtx(context);
  return patch;
}

class PackageTest : public StoreKit {
 protected:
  void ExpectRefused(const std::string& bytes, ErrorCode code, const std::string& word) {
    const Status status = InstallPackage(bytes).status();
    EXPECT_EQ(status.code(), code) << status.message();
    EXPECT_NE(status.message().find(word), std::string::npos) << status.message();
    EXPECT_TRUE(ListVersions(layout_).value().empty());
  }
  // The tile that builds 1 and 2 differ in, shipped as a patch.
  Entries DeltaFromOneToTwo() {
    Entries entries = EntriesOf(Bundle(2));
    const std::string old_tile = ReadText(Bundle(1) / "tiles/1.h5"),
                      new_tile = ReadText(Bundle(2) / "tiles/1.h5");
    DeltaIndex index;
    index.base = IdOf(Bundle(1)), index.target = IdOf(Bundle(2));
    index.patches = {{Sha256Hex(new_tile), Sha256Hex(old_tile)}};
    Entries out{{kDeltaIndexName, ToJson(index)}, entries[1], entries[2]};
    out.emplace_back(PatchEntryName(Sha256Hex(new_tile)), Patch(old_tile, new_tile));
    const std::string graph = ReadText(Bundle(2) / "graph.h5");
    out.emplace_back(ObjectEntryName(Sha256Hex(graph)), graph);
    return out;
  }
};

TEST_F(PackageTest, AWholeBundleInOneFile) {
  const auto report = InstallPackage(PackageBytes(EntriesOf(Bundle(1))));
  ASSERT_TRUE(report.ok()) << report.status().message();
  EXPECT_EQ(report->num_new_parts, 4U);
  ASSERT_TRUE(ActivateHere(report->id).ok());
  EXPECT_EQ(BuildInForce(), 1);
}

TEST_F(PackageTest, ADeltaRebuildsTheBundleByteForByte) {
  ASSERT_TRUE(InstallFolder(Bundle(1)).ok());
  const auto report = InstallPackage(PackageBytes(DeltaFromOneToTwo()));
  ASSERT_TRUE(report.ok()) << report.status().message();
  EXPECT_EQ(report->num_new_parts, 2U);
  for (const char* part : {"graph.h5", "vocabulary.h5", "tiles/0.h5", "tiles/1.h5", kManifestName})
    EXPECT_EQ(ReadText(layout_.version(report->id) / part), ReadText(Bundle(2) / part)) << part;
}

TEST_F(PackageTest, ADeltaNeedsWhatItBuildsOn) {
  ExpectRefused(PackageBytes(DeltaFromOneToTwo()), ErrorCode::kIncomplete, "install the");
  Entries entries = EntriesOf(Bundle(1));
  entries.pop_back();
  ExpectRefused(PackageBytes(entries), ErrorCode::kIncomplete, "does not hold");
}

TEST_F(PackageTest, APatchThatMakesSomethingElseIsRefused) {
  ASSERT_TRUE(InstallFolder(Bundle(1)).ok());
  Entries delta = DeltaFromOneToTwo();
  const std::string old_tile = ReadText(Bundle(1) / "tiles/1.h5");
  std::string forged = ReadText(Bundle(2) / "tiles/1.h5");
  const auto code_with = [&](const std::string& patch) {
    delta[3].second = patch;
    return InstallPackage(PackageBytes(delta)).status().code();
  };
  forged[forged.size() / 2] ^= 1;
  EXPECT_EQ(code_with(Patch(old_tile, forged)), ErrorCode::kMixedParts);
  EXPECT_EQ(code_with(Patch(old_tile, forged.substr(1))), ErrorCode::kIncomplete);
  // A few bytes that unpack to a gigabyte.
  EXPECT_EQ(code_with(Patch("", std::string(std::size_t{1} << 28, 'x'))), ErrorCode::kBadData)
      << "its window is larger than agreed";
  EXPECT_EQ(code_with(Patch(old_tile, forged + std::string(100, 'x'))), ErrorCode::kEndlessData);
  const std::string good = Patch(old_tile, ReadText(Bundle(2) / "tiles/1.h5"));
  EXPECT_EQ(code_with(good.substr(0, good.size() / 2)), ErrorCode::kIncomplete);
  EXPECT_EQ(code_with(good + "more"), ErrorCode::kBadData);
  EXPECT_EQ(code_with("rubbish"), ErrorCode::kBadData);
  EXPECT_EQ(code_with(good), ErrorCode::kOk);
}

TEST_F(PackageTest, TruncatedAnywhereItIsRefused) {
  const std::string bytes = PackageBytes(EntriesOf(Bundle(1)));
  for (std::size_t size = 0; size < bytes.size(); size += 509)
    ExpectRefused(bytes.substr(0, size), ErrorCode::kIncomplete, "fetch the package again");
  ExpectRefused(bytes.substr(0, bytes.size() - 1), ErrorCode::kIncomplete, "ends before");
  ExpectRefused(bytes + "x", ErrorCode::kBadData, "after its end");
}

TEST_F(PackageTest, NamesThatLeadElsewhereAreRefused) {
  const std::string good = PackageBytes(EntriesOf(Bundle(1)));
  const std::size_t at = good.find("objects/");
  ASSERT_NE(at, std::string::npos);
  const auto with_name = [&](const std::string& name) {
    std::string bytes = good;
    return bytes.replace(at, name.size() + 1, name + '\0');
  };
  ExpectRefused(with_name("../../../../tmp/evil"), ErrorCode::kBadData, "leads out");
  ExpectRefused(with_name("/tmp/evil"), ErrorCode::kBadData, "absolute name");
  ExpectRefused(with_name("state.json"), ErrorCode::kBadData, "no part of a package");
  std::string link = good;
  link[at + 156] = '2';
  ExpectRefused(link, ErrorCode::kBadData, "link");
  link[at + 156] = '1';
  ExpectRefused(link, ErrorCode::kBadData, "link");
}

TEST_F(PackageTest, EntriesComeInTheirOrder) {
  const Entries good = EntriesOf(Bundle(1));
  Entries swapped = good;
  std::swap(swapped[0], swapped[1]);
  ExpectRefused(PackageBytes(swapped), ErrorCode::kBadData, "delta.json");
  ExpectRefused(PackageBytes({good[0], good[1], good[3]}), ErrorCode::kBadData, "minisig");
  ExpectRefused(PackageBytes({good[0]}), ErrorCode::kBadData, "no manifest");
  ExpectRefused(PackageBytes({}), ErrorCode::kBadData, "delta.json");
  Entries twice = good;
  twice.push_back(good[1]);
  ExpectRefused(PackageBytes(twice), ErrorCode::kBadData, "too late");
  Entries stranger = good;
  stranger.emplace_back(ObjectEntryName(std::string(64, '0')), "stranger");
  ExpectRefused(PackageBytes(stranger), ErrorCode::kMixedParts, "not in the signed manifest");
}

TEST_F(PackageTest, AManifestOfAnotherBundleIsRefused) {
  Entries entries = EntriesOf(Bundle(1));
  entries[0] = EntriesOf(Bundle(2))[0];
  ExpectRefused(PackageBytes(entries), ErrorCode::kBadData, "not that of the bundle");
}

TEST_F(PackageTest, HugeEntriesCostNothing) {
  Entries entries = EntriesOf(Bundle(1));
  std::string bytes;
  const TarBlock header = EncodeTarHeader({kDeltaIndexName, kMaxEntryBytes});
  bytes.append(header.begin(), header.end());
  ExpectRefused(bytes, ErrorCode::kEndlessData, "at most");
}

TEST_F(PackageTest, AnEndorsedKeyComesAlong) {
  const fs::path bundle = Bundle(1);
  SignFolder(bundle, other_);
  Entries entries = EntriesOf(bundle);
  const std::string name = KeyEntryName(other_.id());
  entries.insert(entries.begin() + 1, {name + kSignatureSuffix, signer_.Endorse(other_.key())});
  entries.insert(entries.begin() + 1, {name, FormatPublicKey(other_.key())});
  const auto report = InstallPackage(PackageBytes(entries));
  ASSERT_TRUE(report.ok()) << report.status().message();
  const StoreKeys keys = ReadStoreKeys(layout_).value();
  ASSERT_EQ(keys.ring.trusted.size(), 2U);
  EXPECT_EQ(keys.endorsed_by[1], signer_.id());
}

TEST_F(PackageTest, AKeyThatNoTrustedOneEndorsesIsRefused) {
  const fs::path bundle = Bundle(1);
  SignFolder(bundle, other_);
  Entries entries = EntriesOf(bundle);
  const std::string name = KeyEntryName(other_.id());
  entries.insert(entries.begin() + 1, {name + kSignatureSuffix, other_.Endorse(other_.key())});
  entries.insert(entries.begin() + 1, {name, FormatPublicKey(other_.key())});
  ExpectRefused(PackageBytes(entries), ErrorCode::kUntrusted, "not trusted here");
  EXPECT_EQ(ReadStoreKeys(layout_).value().ring.trusted.size(), 1U);
}

}  // namespace
}  // namespace panofix
