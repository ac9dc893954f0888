#include "runtime/store/upkeep.h"

#include <gtest/gtest.h>

#include "tests/runtime/store/store_kit.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

class UpkeepTest : public StoreKit {
 protected:
  std::size_t NumObjects() const {
    std::size_t n = 0;
    for (const auto& entry : fs::recursive_directory_iterator(layout_.objects()))
      n += entry.is_regular_file() ? 1 : 0;
    return n;
  }
  std::string PartHash(std::int64_t build, const std::string& path) {
    const SignedManifest version = ReadVersion(layout_, IdOf(Bundle(build))).value();
    for (const BundlePart& part : version.manifest.parts) {
      if (part.path == path) return part.sha256;
    }
    return {};
  }
  static void Damage(const fs::path& path) {
    fs::permissions(path, fs::perms::owner_all);
    std::string text = ReadText(path);
    text[text.size() / 2] ^= 1;
    WriteText(path, text);
  }
};

TEST_F(UpkeepTest, KeepsWhatMayBeNeeded) {
  Run(1);
  const std::string two = Run(2), three = Run(3), four = Run(4);
  ASSERT_TRUE(InstallFolder(Bundle(5)).ok());
  const auto hold = VersionHold::Take(layout_, two);
  ASSERT_TRUE(hold.ok());
  const auto report = CollectGarbage(layout_);
  ASSERT_TRUE(report.ok()) << report.status().message();
  EXPECT_EQ(report->removed_versions, std::vector<std::string>{IdOf(Bundle(1))});
  EXPECT_EQ(report->num_removed_objects, 2U);  // build 1's tile and graph
  EXPECT_EQ(ListVersions(layout_).value().size(), 4U);
  EXPECT_EQ(BuildInForce(), 4);
  EXPECT_TRUE(CheckStore(layout_, false).value().faults.empty());
}

TEST_F(UpkeepTest, WhatIsNoLongerHeldGoes) {
  const std::string one = Run(1);
  Run(2), Run(3);
  { const auto hold = VersionHold::Take(layout_, one); }
  EXPECT_EQ(CollectGarbage(layout_).value().removed_versions.size(), 1U);
  EXPECT_EQ(VersionHold::Take(layout_, one).status().code(), ErrorCode::kTryAgain);
}

TEST_F(UpkeepTest, LeftoversOfInterruptedWorkGo) {
  Run(1);
  WriteText(layout_.staging() / "object-half", "half");
  WriteText(layout_.downloads() / "some.pfb", "half");
  WriteText(layout_.objects() / "zz" / "stray", "stray");
  const auto report = CollectGarbage(layout_);
  EXPECT_EQ(report.value().num_removed_objects, 1U);
  EXPECT_TRUE(fs::is_empty(layout_.staging()));
  EXPECT_TRUE(fs::is_empty(layout_.downloads()));
}

TEST_F(UpkeepTest, WhileAManifestIsUnreadableNoObjectGoes) {
  Run(1);
  const std::string two = Run(2);
  const std::size_t num_objects = NumObjects();
  WriteText(layout_.version(two) / kManifestName, "rubbish");
  EXPECT_FALSE(CollectGarbage(layout_).ok());
  EXPECT_EQ(NumObjects(), num_objects);
}

TEST_F(UpkeepTest, ASoundStoreHasNoFaults) {
  Run(1), Run(2);
  const auto report = CheckStore(layout_, false);
  ASSERT_TRUE(report.ok()) << report.status().message();
  EXPECT_TRUE(report->faults.empty()) << report->faults.front();
  EXPECT_EQ(report->num_versions, 2U);
  EXPECT_EQ(report->num_objects, 6U);
}

TEST_F(UpkeepTest, DamageIsFoundAndTheVersionBeforeTakesOver) {
  const std::string one = Run(1), two = Run(2);
  Damage(layout_.object(PartHash(2, "graph.h5")));  // the version's file too: one inode
  const auto found = CheckStore(layout_, false);
  ASSERT_TRUE(found.ok());
  EXPECT_GE(found->faults.size(), 2U);
  EXPECT_TRUE(found->repairs.empty());
  EXPECT_EQ(State().active, two);
  ASSERT_TRUE(CheckStore(layout_, true).ok());
  EXPECT_EQ(State().active, one);
  EXPECT_EQ(BuildInForce(), 1);
  EXPECT_TRUE(CheckStore(layout_, false).value().faults.empty());
  // And it can be installed again.
  EXPECT_TRUE(InstallFolder(Bundle(2)).ok());
  EXPECT_TRUE(ActivateHere("").ok());
  EXPECT_EQ(BuildInForce(), 2);
}

TEST_F(UpkeepTest, LinksAreMendedFromTheGoodSide) {
  const std::string one = Run(1);
  fs::remove(layout_.object(PartHash(1, "graph.h5")));
  fs::remove(layout_.version(one) / "tiles/0.h5");
  EXPECT_FALSE(CheckStore(layout_, false).value().faults.empty());
  const auto report = CheckStore(layout_, true);
  ASSERT_TRUE(report.ok());
  EXPECT_EQ(report->repairs.size(), 2U);
  EXPECT_TRUE(CheckStore(layout_, false).value().faults.empty());
  EXPECT_EQ(BuildInForce(), 1);
}

TEST_F(UpkeepTest, AnUnreadableStateIsMadeAnew) {
  Run(1);
  const std::string two = Run(2);
  WriteText(layout_.state(), "{\"format\": 1, \"active\": \"../../x\"}");
  EXPECT_EQ(InstallFolder(Bundle(3)).status().code(), ErrorCode::kBadData);
  EXPECT_EQ(CheckStore(layout_, false).value().faults.size(), 1U);
  ASSERT_TRUE(CheckStore(layout_, true).ok());
  EXPECT_EQ(State().active, two);
  EXPECT_TRUE(InstallFolder(Bundle(3)).ok());
}

TEST_F(UpkeepTest, ALostStateIsRebuiltAsStrictAsCanBeKnown) {
  Run(1);
  const std::string two = Run(2), three = InstallFolder(Bundle(3)).value().id;
  const StoreState before = State();
  Damage(layout_.object(PartHash(3, "graph.h5")));  // its manifest still tells its number
  fs::remove(layout_.state());
  EXPECT_EQ(InstallFolder(Bundle(1)).status().code(), ErrorCode::kBadData);
  EXPECT_NE(CheckStore(layout_, false).value().faults.back().find("missing"), std::string::npos);
  const auto report = CheckStore(layout_, true);
  ASSERT_TRUE(report.ok());
  EXPECT_TRUE(report->in_force.ok());
  EXPECT_EQ(State().active, two);
  EXPECT_EQ(State().highest_build, 3);
  EXPECT_EQ(State().highest_id, three);
  EXPECT_EQ(State().time_floor_s, before.time_floor_s);
  EXPECT_EQ(InstallFolder(Bundle(1)).status().code(), ErrorCode::kDowngrade);
}

TEST_F(UpkeepTest, AnEmptyStoreMayLackItsState) {
  fs::remove(layout_.state());
  EXPECT_TRUE(CheckStore(layout_, false).value().faults.empty());
  EXPECT_TRUE(CheckStore(layout_, true).value().in_force.ok());
}

TEST_F(UpkeepTest, WhereNothingIsLeftInForceTheMendIsSaid) {
  Run(1), Run(2);
  const std::string shared = PartHash(1, "tiles/0.h5");
  ASSERT_EQ(shared, PartHash(2, "tiles/0.h5"));
  const std::size_t num_objects = NumObjects();
  Damage(layout_.object(shared));
  const auto report = CheckStore(layout_, true);
  ASSERT_TRUE(report.ok());
  EXPECT_EQ(report->in_force.code(), ErrorCode::kNotFound);
  EXPECT_NE(report->in_force.message().find("install build 2"), std::string::npos);
  EXPECT_EQ(State().active, "");
  // Only the damaged part has to come again.
  EXPECT_EQ(NumObjects(), num_objects - 1);
  EXPECT_EQ(InstallFolder(Bundle(2)).value().num_new_parts, 1U);
}

TEST_F(UpkeepTest, OneGoodCopyMendsAllVersions) {
  const std::string one = Run(1), two = Run(2);
  const std::string shared = PartHash(1, "tiles/0.h5");
  // Build 2 has a copy of its own.
  const fs::path path = layout_.version(two) / "tiles/0.h5";
  const std::string text = ReadText(path);
  fs::remove(path);
  WriteText(path, text);
  Damage(layout_.object(shared));
  const auto report = CheckStore(layout_, true);
  ASSERT_TRUE(report.ok());
  EXPECT_TRUE(CheckStore(layout_, false).value().faults.empty());
  EXPECT_EQ(State().active, two);
  EXPECT_EQ(State().previous, one);
}

TEST_F(UpkeepTest, WhatARevokedKeySignedIsGarbageAndNoDamage) {
  const std::string one = Run(1);
  ASSERT_TRUE(TrustKey(layout_, FormatPublicKey(other_.key()), "", "two").ok());
  SignFolder(Bundle(2), other_);
  const std::string two = Run(2);
  ASSERT_TRUE(RevokeKey(layout_, signer_.id()).ok());
  EXPECT_TRUE(CheckStore(layout_, false).value().faults.empty());
  const StoreVersion revoked = ListVersions(layout_).value().front();
  EXPECT_TRUE(revoked.is_revoked());
  EXPECT_EQ(revoked.manifest.manifest.build, 1);
  EXPECT_EQ(State().previous, one);
  const auto report = CollectGarbage(layout_);
  ASSERT_TRUE(report.ok()) << report.status().message();
  EXPECT_EQ(report->removed_versions, std::vector<std::string>{one});
  EXPECT_EQ(State().previous, "");
  EXPECT_EQ(State().active, two);
  EXPECT_EQ(BuildInForce(), 2);
}

TEST_F(UpkeepTest, TheActiveVersionIsNeverGarbage) {
  const std::string one = Run(1);
  ASSERT_TRUE(TrustKey(layout_, FormatPublicKey(other_.key()), "", "two").ok());
  SignFolder(Bundle(2), other_);
  ASSERT_TRUE(InstallFolder(Bundle(2)).ok());
  const Status refused = RevokeKey(layout_, signer_.id());
  EXPECT_EQ(refused.code(), ErrorCode::kInvalidArgument);
  EXPECT_NE(refused.message().find("--force"), std::string::npos);
  EXPECT_EQ(BuildInForce(), 1);
  ASSERT_TRUE(RevokeKey(layout_, signer_.id(), true).ok());
  const std::size_t num_objects = NumObjects();
  ASSERT_TRUE(CollectGarbage(layout_).ok());
  EXPECT_EQ(NumObjects(), num_objects);
  // It is no longer served: that is a fault, and the next best takes over.
  EXPECT_EQ(CheckStore(layout_, false).value().faults.size(), 1U);
  ASSERT_TRUE(CheckStore(layout_, true).ok());
  EXPECT_EQ(State().active, IdOf(Bundle(2)));
}

}  // namespace
}  // namespace panofix
