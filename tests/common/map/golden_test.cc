// Bundles of every format version that was ever written, kept under schemas/golden: they open, or
// are refused, as schemas/README.md promises. Never made anew: a reader must live with what is out
// there.
#include <gtest/gtest.h>

#include <set>

#include "common/map/map_bundle.h"

namespace panofix {
namespace {

const std::filesystem::path kGolden = std::filesystem::path(PANOFIX_SOURCE_DIR) / "schemas/golden";

// What all bundles of format 2 hold, however they say it.
void ExpectGoldenContent(const MapBundle& bundle) {
  EXPECT_EQ(bundle.manifest().name, "golden");
  EXPECT_EQ(bundle.manifest().build, 7);
  EXPECT_EQ(bundle.panoramas().size(), 2U);
  EXPECT_EQ(bundle.stations().size(), 5U);
  EXPECT_EQ(bundle.views().size(), 40U);
  EXPECT_EQ(bundle.num_landmarks(), static_cast<std::size_t>(bundle.manifest().num_landmarks));
  EXPECT_GT(bundle.num_landmarks(), 50U);
  EXPECT_TRUE(bundle.vocabulary().Check().ok());
}

TEST(Golden, FormatOneIsRefused) {
  const Status status = MapBundle::Open(kGolden / "bundle-1.0").status();
  EXPECT_EQ(status.code(), ErrorCode::kUnsupportedVersion);
  EXPECT_NE(status.message().find("build the bundle again"), std::string::npos);
}

TEST(Golden, FormatTwoZeroOpensUnsigned) {
  const auto bundle = MapBundle::Open(kGolden / "bundle-2.0");
  ASSERT_TRUE(bundle.ok()) << bundle.status().message();
  EXPECT_EQ((*bundle)->manifest().minor, 0);
  EXPECT_FALSE((*bundle)->release());
  ExpectGoldenContent(**bundle);
}

TEST(Golden, FormatTwoOneOpensWithItsSignature) {
  const auto ring = ReadKeyRing({kGolden / "release.pub"});
  ASSERT_TRUE(ring.ok()) << ring.status().message();
  const auto bundle = MapBundle::Open(kGolden / "bundle-2.1", *ring);
  ASSERT_TRUE(bundle.ok()) << bundle.status().message();
  EXPECT_EQ((*bundle)->manifest().minor, 1);
  EXPECT_EQ((*bundle)->release()->statement.build, 7);
  EXPECT_EQ((*bundle)->manifest().vocabulary_release.rfind("sha256:", 0), 0U);
  ExpectGoldenContent(**bundle);
}

TEST(Golden, FormatTwoTwoKeepsTheWordsThatReadersOfTheOthersDerive) {
  const auto ring = ReadKeyRing({kGolden / "release-2.2.pub"});
  ASSERT_TRUE(ring.ok()) << ring.status().message();
  const auto bundle = MapBundle::Open(kGolden / "bundle-2.2", *ring);
  ASSERT_TRUE(bundle.ok()) << bundle.status().message();
  EXPECT_EQ((*bundle)->manifest().minor, 2);
  EXPECT_EQ((*bundle)->release()->statement.build, 7);
  ExpectGoldenContent(**bundle);
  const MapTile& tile = (*bundle)->tiles().Get(0);
  const std::vector<std::uint32_t> derived = tile.DeriveWords((*bundle)->vocabulary().sift);
  EXPECT_GT(std::set<std::uint32_t>(derived.begin(), derived.end()).size(), 10U);
  EXPECT_EQ(std::vector<std::uint32_t>(tile.words().begin(), tile.words().end()), derived);
  EXPECT_TRUE(MapBundle::Open(kGolden / "bundle-2.1").value()->tiles().Get(0).words().empty());
}

TEST(Golden, EveryVersionThatThisReleaseWritesHasOne) {
  const auto name = "bundle-" + std::to_string(kBundleMajor) + "." + std::to_string(kBundleMinor);
  EXPECT_TRUE(std::filesystem::is_directory(kGolden / name))
      << "a step of the format brings its golden bundle: " << name;
}

}  // namespace
}  // namespace panofix
