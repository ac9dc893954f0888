#include "common/map/map_bundle.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <limits>
#include <map>

#include "common/io/sha256.h"
#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"
#include "tests/support/matchers.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

std::shared_ptr<const MapBundle> OpenOrFail(const fs::path& folder) {
  auto bundle = MapBundle::Open(folder);
  EXPECT_TRUE(bundle.ok()) << bundle.status().message();
  return bundle.ok() ? *bundle : nullptr;
}

TEST(MapBundle, HoldsWhatWasWritten) {
  const TempFolder folder;
  const CraftedBundle crafted = SmallBundle();
  crafted.Write(folder / "b");
  const auto bundle = OpenOrFail(folder / "b");
  ASSERT_TRUE(bundle);
  EXPECT_EQ(bundle->manifest().name, "small");
  EXPECT_EQ(bundle->id(), *Sha256OfFile(folder / "b" / kManifestName));
  ASSERT_EQ(bundle->panoramas().size(), 4U);
  for (std::size_t p = 0; p < 4; ++p) {
    const MapPanorama& panorama = bundle->panoramas()[p];
    EXPECT_EQ(panorama.id, crafted.ids[p]);
    EXPECT_EQ(panorama.map_from_pano.translation,
              Eigen::Vector3d(0, 10.0 * static_cast<double>(p), 2.5));
    EXPECT_EQ(panorama.has_depth, p != 3);
    EXPECT_NEAR(panorama.position.lat_deg, 48.85, 1e-3);
    EXPECT_EQ(panorama.point_scale, crafted.scales[p]);
  }
  EXPECT_EQ(bundle->panoramas()[1].links, (std::vector<std::uint32_t>{0, 2}));
  ASSERT_EQ(bundle->views().size(), 8U);
  EXPECT_EQ(bundle->views()[5].panorama_idx, 2U);
  EXPECT_EQ(bundle->views()[5].yaw_deg, 180.0);
  EXPECT_EQ(bundle->views()[5].pitch_deg, 5.0);
  EXPECT_EQ(bundle->vocabulary().sift.centroids, crafted.vocabulary.sift.centroids);
  EXPECT_EQ(bundle->vocabulary().num_words(), 6U);
  EXPECT_EQ(bundle->vocabulary().idf, crafted.vocabulary.idf);
}

TEST(MapBundle, EveryViewHasItsOwnFeatures) {
  const TempFolder folder;
  SmallBundle().Write(folder / "b");
  const auto bundle = OpenOrFail(folder / "b");
  ASSERT_TRUE(bundle);
  for (std::uint32_t view = 0; view < 8; ++view) {
    const std::uint32_t p = view / 2, v = view % 2;
    const ViewFeatures features = bundle->Features(view);
    ASSERT_EQ(features.size(), (3 * p + 2 * v) % 6) << view;
    EXPECT_EQ(features.descriptors.size(), features.size() * kDescriptorSize);
    for (std::size_t i = 0; i < features.size(); ++i) {
      const auto at = static_cast<float>(100 * p + 10 * v + i);
      EXPECT_EQ(features.keypoints[4 * i], at);
      EXPECT_EQ(features.point(i), Eigen::Vector3d(double{at}, 1, 2));
      EXPECT_EQ(features.range_sigma_m(i), 0.25);
      EXPECT_EQ(features.surfaces[i], 1 + i % 2);
    }
    ASSERT_EQ(bundle->bags()[view].size(), 2U);
    EXPECT_EQ(bundle->bags()[view][0].word, view % 4);
    EXPECT_EQ(bundle->bags()[view][1].word, 4 + v);
    const auto similar = bundle->SimilarViews(view);
    ASSERT_EQ(similar.size(), 2U);
    EXPECT_EQ(similar[0], (view + 2) % 8);
    EXPECT_EQ(similar[1], (view + 1) % 8);
  }
  EXPECT_THROW((void)bundle->Features(8), std::out_of_range);
}

TEST(MapBundle, SurfaceNormalsAreUnitOrZero) {
  const TempFolder folder;
  CraftedBundle crafted = SmallBundle();
  // The second panorama's ground: not quite unit; its wall: no plane at all.
  for (std::size_t k = 0; k < 4; ++k) crafted.tiles[0].planes[16 + k] *= 1.5F;
  crafted.tiles[0].planes[20] = std::numeric_limits<float>::quiet_NaN();
  crafted.Write(folder / "b");
  const auto bundle = OpenOrFail(folder / "b");
  ASSERT_TRUE(bundle);
  for (const std::size_t p : {0, 1, 2, 3}) {
    EXPECT_EQ(bundle->SurfaceNormal(p, 0), Eigen::Vector3d::Zero());
    EXPECT_EQ(bundle->SurfaceNormal(p, 1), Eigen::Vector3d::UnitZ());
    EXPECT_EQ(bundle->SurfaceNormal(p, 2), Eigen::Vector3d(p == 1 ? 0 : 1, 0, 0));
    EXPECT_EQ(bundle->SurfaceNormal(p, 3), Eigen::Vector3d::Zero());
    EXPECT_EQ(bundle->SurfaceNormal(p, 255), Eigen::Vector3d::Zero());
  }
  EXPECT_THROW((void)bundle->SurfaceNormal(4, 0), std::out_of_range);
}

TEST(MapBundle, TilesMayComeInAnyOrder) {
  const TempFolder folder;
  CraftedBundle crafted = SmallBundle();
  std::swap(crafted.tiles[0].path, crafted.tiles[1].path);
  crafted.Write(folder / "b");
  const auto bundle = OpenOrFail(folder / "b");
  ASSERT_TRUE(bundle);
  EXPECT_EQ(bundle->Features(3).size(), 5U);
  EXPECT_EQ(bundle->Features(3).keypoints[0], 110.0F);
}

TEST(MapBundle, ABundleWithoutFeaturesOpens) {
  const TempFolder folder;
  CraftedBundle crafted = SmallBundle();
  crafted.tiles.clear();
  CraftedTile& tile = crafted.tiles.emplace_back();
  tile.path = "tiles/0.h5";
  tile.panorama_ids = crafted.ids;
  for (int view = 0; view < 8; ++view) tile.EndView({});
  for (int panorama = 0; panorama < 4; ++panorama) tile.EndPanorama({});
  crafted.Write(folder / "b");
  const auto bundle = OpenOrFail(folder / "b");
  ASSERT_TRUE(bundle);
  EXPECT_EQ(bundle->Features(7).size(), 0U);
  EXPECT_TRUE(bundle->bags()[7].empty());
}

TEST(MapBundle, PartsOfLaterMinorVersionsAreVerifiedAndLeftAlone) {
  const TempFolder folder;
  CraftedBundle crafted = SmallBundle();
  crafted.manifest.minor = kBundleMinor + 1;
  crafted.extra_parts = {{"landmarks/notes.txt", "not an HDF5 file"}};
  crafted.Write(folder / "b");
  EXPECT_TRUE(OpenOrFail(folder / "b"));
  WriteText(folder / "b" / "landmarks/notes.txt", "not an HDF5 filE");
  EXPECT_EQ(MapBundle::Open(folder / "b").status().code(), ErrorCode::kChecksumMismatch);
}

// Every file with its size, times and content.
std::map<std::string, std::string> Snapshot(const fs::path& folder) {
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    struct stat info {};
    EXPECT_EQ(::stat(entry.path().c_str(), &info), 0);
    std::string text = std::to_string(info.st_mtim.tv_sec) + "." +
                       std::to_string(info.st_mtim.tv_nsec) + " " + std::to_string(info.st_ino) +
                       " ";
    if (entry.is_regular_file()) text += ReadText(entry.path());
    files[entry.path().string()] = text;
  }
  return files;
}

TEST(MapBundle, OpeningTouchesNothing) {
  const TempFolder folder;
  SmallBundle().Write(folder / "b");
  for (const auto& entry : fs::recursive_directory_iterator(folder / "b")) {
    if (entry.is_regular_file()) fs::permissions(entry.path(), fs::perms::owner_read);
  }
  fs::permissions(folder / "b", fs::perms::owner_read | fs::perms::owner_exec);
  const auto before = Snapshot(folder / "b");
  {
    const auto bundle = OpenOrFail(folder / "b");
    ASSERT_TRUE(bundle);
    EXPECT_EQ(bundle->Features(3).size(), 5U);
  }
  EXPECT_EQ(Snapshot(folder / "b"), before);
  fs::permissions(folder / "b", fs::perms::owner_all);
}

TEST(MapBundle, OutlivesItsFiles) {
  const TempFolder folder;
  SmallBundle().Write(folder / "b");
  const auto bundle = OpenOrFail(folder / "b");
  ASSERT_TRUE(bundle);
  // A newer bundle replaces the folder while the old one is in use.
  fs::remove_all(folder / "b");
  EXPECT_EQ(bundle->Features(3).keypoints[0], 110.0F);
  EXPECT_EQ(bundle->SimilarViews(0)[0], 2U);
}

TEST(MapBundle, AFolderThatIsNotThere) {
  const TempFolder folder;
  const auto bundle = MapBundle::Open(folder / "none");
  EXPECT_EQ(bundle.status().code(), ErrorCode::kNotFound);
  EXPECT_NE(bundle.status().message().find("none"), std::string::npos);
  EXPECT_EQ(MapBundle::Open(folder.path()).status().code(), ErrorCode::kNotFound);
  WriteText(folder / "file", "x");
  EXPECT_EQ(MapBundle::Open(folder / "file").status().code(), ErrorCode::kNotFound);
}

}  // namespace
}  // namespace panofix
