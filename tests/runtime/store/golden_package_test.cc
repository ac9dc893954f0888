// The package of every format version that was ever written, kept under schemas/golden.
#include <gtest/gtest.h>

#include "tests/runtime/store/store_kit.h"

namespace panofix {
namespace {

TEST(GoldenPackage, FormatOneIsInstalled) {
  const std::filesystem::path golden = std::filesystem::path(PANOFIX_SOURCE_DIR) / "schemas/golden";
  const TempFolder folder;
  const StoreLayout layout{folder / "store"};
  const std::string text = ReadText(golden / "bundle-2.1" / kManifestName);
  const Manifest manifest = ParseManifest(text, "m").value();
  const auto ring = ReadKeyRing({golden / "release.pub"});
  ASSERT_TRUE(ring.ok()) << ring.status().message();
  ASSERT_TRUE(InitStore(layout, {"golden", manifest.camera}, *ring).ok());
  // It expires one day; the golden release is from before that.
  const auto report = Install(layout, *MakePackageSource(golden / "package-1.0.pfb"), {});
  if (report.status().code() == ErrorCode::kExpired) GTEST_SKIP() << report.status().message();
  ASSERT_TRUE(report.ok()) << report.status().message();
  EXPECT_EQ(report->build, 7);
  ASSERT_TRUE(Activate(layout, "", OpeningProbe(layout)).ok());
  EXPECT_EQ(OpenedBuild(layout), 7);
}

}  // namespace
}  // namespace panofix
