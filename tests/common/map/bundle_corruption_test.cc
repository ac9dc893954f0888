// A bundle whose bytes are not the manifest's must not open, whatever byte it is.
#include <gtest/gtest.h>

#include <set>

#include "common/base/rng.h"
#include "common/map/map_bundle.h"
#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

const char* const kParts[] = {"graph.h5", "vocabulary.h5", "tiles/0.h5", "tiles/1.h5"};

class BundleCorruption : public testing::Test {
 protected:
  void SetUp() override { SmallBundle().Write(root()); }
  [[nodiscard]] fs::path root() const { return folder_ / "b"; }
  [[nodiscard]] Status Open() const { return MapBundle::Open(root()).status(); }
  // The file with one bit of one byte flipped, opened, and put back.
  Status OpenFlipped(const std::string& path, const std::string& good, std::size_t at, int bit) {
    std::string bad = good;
    bad[at] = static_cast<char>(bad[at] ^ (1 << bit));
    WriteText(root() / path, bad);
    const Status status = Open();
    WriteText(root() / path, good);
    return status;
  }
  TempFolder folder_;
};

TEST_F(BundleCorruption, FlippedBytesOfPartsAreFound) {
  constexpr int kFlipsPerPart = 120;
  Rng rng(1, "tests/flips");
  for (const char* part : kParts) {
    const std::string good = ReadText(root() / part);
    std::vector<std::size_t> places{0, 1, good.size() / 2, good.size() - 1};
    for (int i = 0; i < kFlipsPerPart; ++i) places.push_back(rng.Below(good.size()));
    for (const std::size_t at : places) {
      const Status status = OpenFlipped(part, good, at, static_cast<int>(rng.Below(8)));
      ASSERT_EQ(status.code(), ErrorCode::kChecksumMismatch) << part << " byte " << at;
      ASSERT_NE(status.message().find(part), std::string::npos) << status.message();
    }
  }
  EXPECT_TRUE(Open().ok());
}

// Tiles are read several at once.
TEST_F(BundleCorruption, OfSeveralFaultsTheFirstInOrderIsTold) {
  for (const char* tile : {"tiles/0.h5", "tiles/1.h5"}) {
    std::string bytes = ReadText(root() / tile);
    bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 1);
    WriteText(root() / tile, bytes);
  }
  for (const std::uint64_t max_tile_bytes : {0, 1}) {
    for (int run = 0; run < 30; ++run) {
      const Status status = MapBundle::Open(root(), {}, max_tile_bytes).status();
      ASSERT_EQ(status.code(), ErrorCode::kChecksumMismatch);
      ASSERT_NE(status.message().find("tiles/0.h5"), std::string::npos) << status.message();
    }
  }
}

TEST_F(BundleCorruption, EveryFlippedByteOfTheManifestIsFound) {
  const std::string good = ReadText(root() / kManifestName);
  // Bytes whose flip makes it a manifest for other releases, which is told first: the format's
  // major, and the oldest release (0.1.0) that becomes a later one.
  const std::size_t major_at = good.find("\"major\": ") + 9;
  const std::size_t oldest_at = good.find("\"min\": \"") + 8;
  const std::set<std::size_t> told_first{major_at, oldest_at, oldest_at + 4};
  for (std::size_t at = 0; at < good.size(); ++at) {
    const ErrorCode code = OpenFlipped(kManifestName, good, at, 0).code();
    ASSERT_EQ(code, told_first.contains(at) ? ErrorCode::kUnsupportedVersion
                                            : ErrorCode::kChecksumMismatch)
        << at;
  }
  const std::string hash = ReadText(root() / kManifestHashName);
  for (std::size_t at = 0; at < 64; ++at) {
    ASSERT_EQ(OpenFlipped(kManifestHashName, hash, at, 1).code(), ErrorCode::kChecksumMismatch)
        << at;
  }
  EXPECT_TRUE(Open().ok());
}

TEST_F(BundleCorruption, TruncatedAndGrownFilesAreFound) {
  for (const std::string path :
       {"graph.h5", "vocabulary.h5", "tiles/0.h5", "tiles/1.h5", kManifestName}) {
    const std::string good = ReadText(root() / path);
    for (const std::size_t keep :
         {std::size_t{0}, std::size_t{1}, good.size() / 2, good.size() - 1}) {
      WriteText(root() / path, good.substr(0, keep));
      EXPECT_EQ(Open().code(), ErrorCode::kChecksumMismatch) << path << " cut to " << keep;
    }
    WriteText(root() / path, good + '\0');
    EXPECT_EQ(Open().code(), ErrorCode::kChecksumMismatch) << path << " grown";
    WriteText(root() / path, good);
  }
  WriteText(root() / kManifestHashName, "");
  EXPECT_EQ(Open().code(), ErrorCode::kChecksumMismatch);
}

TEST_F(BundleCorruption, MissingFilesAreNamed) {
  for (const std::string path :
       {"graph.h5", "vocabulary.h5", "tiles/0.h5", kManifestName, kManifestHashName}) {
    fs::rename(root() / path, folder_ / "aside");
    const Status status = Open();
    EXPECT_EQ(status.code(), ErrorCode::kNotFound) << path;
    EXPECT_NE(status.message().find(path), std::string::npos) << status.message();
    fs::rename(folder_ / "aside", root() / path);
  }
  EXPECT_TRUE(Open().ok());
}

TEST_F(BundleCorruption, PartsOfTwoBundlesDoNotMix) {
  CraftedBundle other = SmallBundle();
  other.tiles[0].points[0] += 1;
  other.Write(folder_ / "other");
  fs::copy_file(folder_ / "other" / "tiles/0.h5", root() / "tiles/0.h5",
                fs::copy_options::overwrite_existing);
  EXPECT_EQ(Open().code(), ErrorCode::kChecksumMismatch);
}

TEST_F(BundleCorruption, AFolderInAPartsPlaceIsNoPart) {
  fs::remove(root() / "tiles/0.h5");
  fs::create_directory(root() / "tiles/0.h5");
  EXPECT_FALSE(Open().ok());
}

TEST_F(BundleCorruption, ANewerMajorIsAVersionFault) {
  std::string text = ReadText(root() / kManifestName);
  const std::string major = "\"major\": " + std::to_string(kBundleMajor);
  text.replace(text.find(major), major.size(), "\"major\": " + std::to_string(kBundleMajor + 1));
  WriteText(root() / kManifestName, text);
  // A newer format may hash another way: the version comes first.
  EXPECT_EQ(Open().code(), ErrorCode::kUnsupportedVersion);
  SealManifest(root());
  EXPECT_EQ(Open().code(), ErrorCode::kUnsupportedVersion);
}

TEST_F(BundleCorruption, AnOlderMajorIsAVersionFaultThatSaysBuildAgain) {
  std::string text = ReadText(root() / kManifestName);
  const std::string major = "\"major\": " + std::to_string(kBundleMajor);
  text.replace(text.find(major), major.size(), "\"major\": 1");
  WriteText(root() / kManifestName, text);
  SealManifest(root());
  EXPECT_EQ(Open().code(), ErrorCode::kUnsupportedVersion);
  EXPECT_NE(Open().message().find("build"), std::string::npos) << Open().message();
}

TEST_F(BundleCorruption, ReadManifestChecksTheManifestAlone) {
  WriteText(root() / "graph.h5", "broken");
  std::string id;
  const auto manifest = MapBundle::ReadManifest(root(), &id);
  ASSERT_TRUE(manifest.ok()) << manifest.status().message();
  EXPECT_EQ(manifest->parts.size(), 4U);
  EXPECT_EQ(id, ReadText(root() / kManifestHashName).substr(0, 64));
}

}  // namespace
}  // namespace panofix
