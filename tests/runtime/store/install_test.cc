// What gets into a store, and what does not: each threat is played and refused with its own code.
#include <gtest/gtest.h>

#include "common/io/atomic_file.h"
#include "runtime/store/upkeep.h"
#include "tests/runtime/store/store_kit.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

class InstallTest : public StoreKit {
 protected:
  // The bundle is refused with this code and word, and nothing is installed.
  void ExpectRefused(const fs::path& bundle, ErrorCode code, const std::string& word) {
    const std::size_t before = ListVersions(layout_).value().size();
    const Status status = InstallFolder(bundle).status();
    EXPECT_EQ(status.code(), code) << status.message();
    EXPECT_NE(status.message().find(word), std::string::npos) << status.message();
    EXPECT_NE(status.message().find("; "), std::string::npos) << "no mend: " << status.message();
    EXPECT_EQ(ListVersions(layout_).value().size(), before);
  }
};

TEST_F(InstallTest, ASignedBundleIsInstalledByteForByte) {
  const auto report = InstallFolder(Bundle(1));
  ASSERT_TRUE(report.ok()) << report.status().message();
  EXPECT_EQ(report->build, 1);
  EXPECT_EQ(report->id, IdOf(Bundle(1)));
  EXPECT_EQ(report->num_parts, 4U);
  EXPECT_EQ(report->num_new_parts, 4U);
  for (const auto& entry : fs::recursive_directory_iterator(Bundle(1))) {
    if (!entry.is_regular_file()) continue;
    const fs::path path = fs::relative(entry.path(), Bundle(1));
    EXPECT_EQ(ReadText(layout_.version(report->id) / path), ReadText(entry.path())) << path;
  }
  EXPECT_EQ(State().active, "") << "installed, not in force";
}

TEST_F(InstallTest, PartsThatAreHereAreNotCopiedAgain) {
  ASSERT_TRUE(InstallFolder(Bundle(1)).ok());
  const auto second = InstallFolder(Bundle(2));
  ASSERT_TRUE(second.ok()) << second.status().message();
  EXPECT_EQ(second->num_new_parts, 2U);  // a tile and the graph
  const auto again = InstallFolder(Bundle(2));
  ASSERT_TRUE(again.ok()) << again.status().message();
  EXPECT_EQ(again->num_new_parts, 0U);
}

TEST_F(InstallTest, ADamagedObjectIsFetchedAnew) {
  ASSERT_TRUE(InstallFolder(Bundle(1)).ok());
  const std::string sha256 =
      ReadVersion(layout_, IdOf(Bundle(1))).value().manifest.parts.back().sha256;
  fs::permissions(layout_.object(sha256), fs::perms::owner_all);
  fs::remove(layout_.object(sha256));
  WriteText(layout_.object(sha256), "rubbish");
  const auto again = InstallFolder(Bundle(2));
  ASSERT_TRUE(again.ok()) << again.status().message();
  EXPECT_EQ(again->num_new_parts, 3U);
}

TEST_F(InstallTest, ArbitraryBundlesAreRefused) {
  const fs::path unsigned_bundle = Bundle(1);
  fs::remove(unsigned_bundle / kManifestSignatureName);
  ExpectRefused(unsigned_bundle, ErrorCode::kUntrusted, "not signed");
  SignFolder(unsigned_bundle, other_);
  ExpectRefused(unsigned_bundle, ErrorCode::kUntrusted, other_.id());
  // Signed, then changed.
  const fs::path changed = Bundle(2);
  std::string text = ReadText(changed / kManifestName);
  text.insert(text.size() - 2, " ");
  WriteText(changed / kManifestName, text);
  SealManifest(changed);
  ExpectRefused(changed, ErrorCode::kUntrusted, "does not verify");
  // A signature for something else.
  const fs::path borrowed = Bundle(3);
  WriteText(borrowed / kManifestSignatureName,
            signer_.Sign(ReadText(borrowed / kManifestName), "timestamp:1"));
  ExpectRefused(borrowed, ErrorCode::kUntrusted, "no release statement");
  SignFolder(borrowed, signer_, [](ReleaseStatement* s) { s->build = 9; });
  ExpectRefused(borrowed, ErrorCode::kUntrusted, "its signature is for build 9");
}

TEST_F(InstallTest, DowngradesAreRefused) {
  ASSERT_TRUE(InstallFolder(Bundle(5)).ok());
  ExpectRefused(Bundle(4), ErrorCode::kDowngrade, "build 5 was here already");
  // Another bundle of the same number.
  ExpectRefused(BundleWith("twin", 5, [](CraftedBundle* b) { b->scales[1] = 1.25; }),
                ErrorCode::kDowngrade, "says to be build 5");
  // The memory of it outlives the version and the state.
  fs::remove(layout_.state());
  ExpectRefused(Bundle(4), ErrorCode::kBadData, "fsck --repair");
  ASSERT_TRUE(CheckStore(layout_, true).ok());
  ExpectRefused(Bundle(4), ErrorCode::kDowngrade, "build 5");
}

TEST_F(InstallTest, FrozenReleasesAreRefused) {
  const fs::path old = BundleWith(
      "old", 1, [](CraftedBundle*) {}, [](ReleaseStatement* s) { s->expires_s = 1710000000; });
  ExpectRefused(old, ErrorCode::kExpired, "expired at 2024-03-09");
  // A clock that was set back does not help: a later release was seen.
  const auto later = [](ReleaseStatement* s) { s->created_s = 3900000000; };
  ASSERT_TRUE(InstallFolder(BundleWith(
                                "later", 2, [](CraftedBundle*) {}, later))
                  .ok());
  const fs::path expired_by_then = BundleWith(
      "then", 3, [](CraftedBundle*) {}, [](ReleaseStatement* s) { s->expires_s = 3800000000; });
  ExpectRefused(expired_by_then, ErrorCode::kExpired, "expired");
}

TEST_F(InstallTest, ARenewedSignatureTakesTheOldOnesPlace) {
  const fs::path bundle = Bundle(1);
  ASSERT_TRUE(InstallFolder(bundle).ok());
  const std::string old_signature = ReadText(bundle / kManifestSignatureName);
  const auto renew = [](ReleaseStatement* s) { s->created_s += 100, s->expires_s += 100; };
  SignFolder(bundle, signer_, renew);
  ASSERT_TRUE(InstallFolder(bundle).ok());
  EXPECT_EQ(ReadVersion(layout_, IdOf(bundle)).value().release->statement.expires_s, 4000000100);
  WriteText(bundle / kManifestSignatureName, old_signature);
  EXPECT_EQ(InstallFolder(bundle).status().code(), ErrorCode::kDowngrade);
  EXPECT_EQ(ReadVersion(layout_, IdOf(bundle)).value().release->statement.expires_s, 4000000100);
}

TEST_F(InstallTest, MixedPartsAreRefused) {
  const fs::path mixed = Bundle(2);
  fs::copy_file(Bundle(1) / "tiles/1.h5", mixed / "tiles/1.h5",
                fs::copy_options::overwrite_existing);
  ExpectRefused(mixed, ErrorCode::kMixedParts, "tiles/1.h5");
}

TEST_F(InstallTest, PartialBundlesAreRefused) {
  fs::remove(Bundle(1) / "tiles/0.h5");
  ExpectRefused(Bundle(1), ErrorCode::kIncomplete, "tiles/0.h5");
  fs::resize_file(Bundle(2) / "graph.h5", 100);
  ExpectRefused(Bundle(2), ErrorCode::kIncomplete, "graph.h5");
}

TEST_F(InstallTest, EndlessDataIsCutOff) {
  const fs::path endless = Bundle(1);
  WriteText(endless / "graph.h5", ReadText(endless / "graph.h5") + std::string(1 << 20, 'x'));
  ExpectRefused(endless, ErrorCode::kEndlessData, "graph.h5");
  InstallOptions small;
  small.max_bytes = 1000;
  EXPECT_EQ(InstallFolder(Bundle(2), small).status().code(), ErrorCode::kEndlessData);
}

TEST_F(InstallTest, BundlesForOthersAreRefused) {
  ExpectRefused(BundleWith("map", 1, [](CraftedBundle* b) { b->manifest.name = "moon"; }),
                ErrorCode::kWrongMap, "'moon'");
  ExpectRefused(BundleWith("size", 1,
                           [](CraftedBundle* b) {
                             b->manifest.camera = Camera::FromHorizontalFov(800, 600, 70);
                           }),
                ErrorCode::kWrongCamera, "800x600");
  ExpectRefused(BundleWith("focal", 1,
                           [](CraftedBundle* b) {
                             b->manifest.camera = Camera::FromHorizontalFov(640, 480, 60);
                           }),
                ErrorCode::kWrongCamera, "focal");
  // A calibration of the same model is fine.
  EXPECT_TRUE(InstallFolder(BundleWith("near", 1, [](CraftedBundle* b) {
                b->manifest.camera = Camera::FromHorizontalFov(640, 480, 71);
              })).ok());
}

TEST_F(InstallTest, FormatsThatThisProgramDoesNotReadAreRefused) {
  ExpectRefused(
      BundleWith("late", 1, [](CraftedBundle* b) { b->manifest.runtime_min = "900.0.0"; }),
      ErrorCode::kUnsupportedVersion, "update panofix");
  ExpectRefused(BundleWith("major", 1, [](CraftedBundle* b) { b->manifest.major = 3; }),
                ErrorCode::kUnsupportedVersion, "bundle format 3");
}

TEST_F(InstallTest, ABundleFromARevokedKeyIsRefused) {
  ASSERT_TRUE(TrustKey(layout_, FormatPublicKey(other_.key()), "", "two").ok());
  ASSERT_TRUE(RevokeKey(layout_, signer_.id()).ok());
  ExpectRefused(Bundle(1), ErrorCode::kKeyRevoked, signer_.id());
  SignFolder(Bundle(1), other_);
  EXPECT_TRUE(InstallFolder(Bundle(1)).ok());
}

TEST_F(InstallTest, OneProcessAtATime) {
  const auto held = StoreLock::Take(layout_);
  ASSERT_TRUE(held.ok());
  ExpectRefused(Bundle(1), ErrorCode::kTryAgain, "another process");
}

TEST_F(InstallTest, AStoreIsMadeOnce) {
  EXPECT_EQ(InitStore(layout_, {kMapName, SmallBundle().manifest.camera}, signer_.ring()).code(),
            ErrorCode::kInvalidArgument);
  EXPECT_EQ(InitStore({folder_ / "b"}, {kMapName, SmallBundle().manifest.camera}, {}).code(),
            ErrorCode::kInvalidArgument);
  EXPECT_EQ(InitStore({folder_ / "c"}, {"", SmallBundle().manifest.camera}, signer_.ring()).code(),
            ErrorCode::kInvalidArgument);
  EXPECT_EQ(Install({folder_ / "none"}, *MakeFolderSource(Bundle(1)), {}).status().code(),
            ErrorCode::kNotFound);
}

}  // namespace
}  // namespace panofix
