#include "common/map/map_bundle.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <map>

#include "common/io/sha256.h"
#include "common/io/unique_fd.h"
#include "common/map/landmark_codes.h"
#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"
#include "tests/support/matchers.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

constexpr double kFloat = 1e-6;      // of numbers near one that are stored as floats
constexpr double kHalfStep = 0.021;  // relative, of a length's code: half of its 4 %, and a little

std::shared_ptr<const MapBundle> OpenOrFail(const fs::path& folder) {
  auto bundle = MapBundle::Open(folder);
  EXPECT_TRUE(bundle.ok()) << bundle.status().message();
  return bundle.ok() ? *bundle : nullptr;
}

TEST(MapBundle, HoldsWhatWasWritten) {
  const TempFolder folder;
  CraftedBundle crafted = SmallBundle();
  crafted.is_flagged[2] = 1;
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
    EXPECT_EQ(panorama.is_flagged, p == 2);
    EXPECT_NEAR(panorama.position.lat_deg, 48.85, 1e-3);
    EXPECT_EQ(panorama.point_scale, crafted.scales[p]);
  }
  EXPECT_EQ(bundle->panoramas()[1].links, (std::vector<std::uint32_t>{0, 2}));
  EXPECT_EQ(bundle->vocabulary().sift.centroids, crafted.vocabulary.sift.centroids);
  EXPECT_EQ(bundle->vocabulary().num_words(), 6U);
  EXPECT_EQ(bundle->vocabulary().idf, crafted.vocabulary.idf);
}

// The limit is meant for this process as a whole, whatever else it has open.
TEST(MapBundle, OpensBesideManyOpenFiles) {
  const TempFolder folder;
  SmallBundle().Write(folder / "b");
  rlimit old{};
  getrlimit(RLIMIT_NOFILE, &old);
  const rlimit low{400, old.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &low), 0);
  std::vector<UniqueFd> others;
  while (true) {
    UniqueFd fd(::open("/dev/null", O_RDONLY | O_CLOEXEC));
    if (!fd.valid()) break;
    others.push_back(std::move(fd));
  }
  constexpr std::size_t kLeft = 2;  // enough to read the manifest, not to hold the parts
  ASSERT_GT(others.size(), kLeft);
  others.resize(others.size() - kLeft);
  EXPECT_TRUE(OpenOrFail(folder / "b"));
  setrlimit(RLIMIT_NOFILE, &old);
}

TEST(MapBundle, StationsAndTheirViewsFollowThePanoramas) {
  const TempFolder folder;
  SmallBundle().Write(folder / "b");
  const auto bundle = OpenOrFail(folder / "b");
  ASSERT_TRUE(bundle);
  ASSERT_EQ(bundle->stations().size(), 5U);
  EXPECT_EQ(bundle->views_per_station(), 2U);
  const std::uint32_t owner[] = {0, 1, 1, 2, 3}, first[] = {0, 1, 3, 4, 5};
  for (std::uint32_t p = 0; p < 5; ++p) EXPECT_EQ(bundle->first_station(p), first[p]);
  ASSERT_EQ(bundle->views().size(), 10U);
  for (std::uint32_t s = 0; s < 5; ++s) {
    EXPECT_EQ(bundle->stations()[s].panorama_idx, owner[s]);
    EXPECT_EQ(bundle->stations()[s].position_in_pano, Eigen::Vector3d(0, s == 2 ? 4 : 0, 0));
    for (std::uint32_t v = 0; v < 2; ++v) {
      const MapView& view = bundle->views()[2 * s + v];
      EXPECT_EQ(view.station_idx, s);
      EXPECT_EQ(view.panorama_idx, owner[s]);
      EXPECT_EQ(view.yaw_deg, v == 0 ? 0.0 : 180.0);
      EXPECT_EQ(view.pitch_deg, v == 0 ? 0.0 : 5.0);
    }
  }
}

TEST(MapBundle, LandmarksAreTheirAnchors) {
  const TempFolder folder;
  const CraftedBundle crafted = SmallBundle();
  crafted.Write(folder / "b");
  const auto bundle = OpenOrFail(folder / "b");
  ASSERT_TRUE(bundle);
  // By tile and anchor: a, b; b again, seen across the border, then c and d.
  std::vector<std::pair<std::uint32_t, std::uint32_t>> expected;  // panorama, number there
  for (std::uint32_t p = 0; p < 4; ++p) {
    if (p == 2) expected.emplace_back(1, 7);
    for (std::uint32_t i = 0; i < 2 + p; ++i) expected.emplace_back(p, i);
  }
  ASSERT_EQ(bundle->num_landmarks(), expected.size());
  for (std::uint32_t id = 0; id < expected.size(); ++id) {
    const auto [p, i] = expected[id];
    const MapLandmark landmark = bundle->Landmark(id);
    EXPECT_EQ(landmark.panorama_idx, p) << id;
    EXPECT_EQ(landmark.point_in_pano, Eigen::Vector3d(100.0 * p + i, 1, 2)) << id;
    EXPECT_NEAR(landmark.range_sigma_m, 0.25, kHalfStep * 0.25);
    EXPECT_NEAR(landmark.point_sigma_m, 0.02, kHalfStep * 0.02);
    EXPECT_NEAR(landmark.size_m, 0.4, kHalfStep * 0.4);
    EXPECT_NEAR(landmark.angle_deg, 30, 0.5 * 360 / 256);
    EXPECT_EQ(landmark.surface_idx, static_cast<int>(1 + i % 2));
    EXPECT_EQ(landmark.num_panoramas, static_cast<int>(1 + p));
    const CraftedTile& tile = crafted.tiles[id < 5 ? 0 : 1];
    std::array<std::uint8_t, kDescriptorSize> descriptor;
    bundle->Descriptor(id, descriptor.data());
    const auto written = tile.descriptors.begin() + kDescriptorSize * (id < 5 ? id : id - 5);
    EXPECT_TRUE(std::equal(descriptor.begin(), descriptor.end(), written)) << id;
  }
}

TEST(MapBundle, EveryViewHasItsOwnLandmarksAndWords) {
  const TempFolder folder;
  SmallBundle().Write(folder / "b");
  const auto bundle = OpenOrFail(folder / "b");
  ASSERT_TRUE(bundle);
  for (std::uint32_t view = 0; view < 10; ++view) {
    const bool second = view >= 6;
    std::vector<std::uint32_t> shown, expected;
    const MapBundle::LandmarkList list = bundle->LandmarksOf(view);
    for (std::size_t i = 0; i < list.size(); ++i) shown.push_back(list[i]);
    for (std::uint32_t n = 0; n < (second ? 10U : 5U); ++n) {
      const std::uint32_t slot = second ? view - 6 : view;
      if ((n + slot) % 3 != 0) expected.push_back(n + (second ? 5 : 0));
    }
    EXPECT_EQ(shown, expected) << view;
    const BagOfWords& bag = bundle->BagOf(view);
    ASSERT_EQ(bag.size(), 2U);
    EXPECT_EQ(bag[0].word, view % 4);
    EXPECT_EQ(bag[1].word, 4 + view % 2);
    // Eight bits a weight, then unit length again.
    EXPECT_NEAR(double{bag[0].weight}, 0.6, 0.5 / 255);
    EXPECT_NEAR(double{bag[1].weight}, 0.8, 0.5 / 255);
    EXPECT_NEAR(std::hypot(double{bag[0].weight}, double{bag[1].weight}), 1, kFloat);
  }
  EXPECT_THROW((void)bundle->LandmarksOf(10), std::out_of_range);
}

TEST(MapBundle, VirtualStationsShareTheirPanoramasSimilarViews) {
  const TempFolder folder;
  SmallBundle().Write(folder / "b");
  const auto bundle = OpenOrFail(folder / "b");
  ASSERT_TRUE(bundle);
  const std::uint32_t row_of_view[] = {0, 1, 2, 3, 2, 3, 4, 5, 6, 7};
  const std::uint32_t native_view[] = {0, 1, 2, 3, 6, 7, 8, 9};
  for (std::uint32_t view = 0; view < 10; ++view) {
    const auto similar = bundle->SimilarViews(view);
    ASSERT_EQ(similar.size(), 2U);
    EXPECT_EQ(similar[0], native_view[(row_of_view[view] + 2) % 8]) << view;
    EXPECT_EQ(similar[1], native_view[(row_of_view[view] + 1) % 8]) << view;
  }
}

TEST(MapBundle, SurfacesAreThoseOfTheAnchor) {
  const TempFolder folder;
  CraftedBundle crafted = SmallBundle();
  crafted.tiles[0].codes[4] = 200;  // the first landmark's plane: none of that number
  crafted.Write(folder / "b");
  const auto bundle = OpenOrFail(folder / "b");
  ASSERT_TRUE(bundle);
  EXPECT_EQ(bundle->SurfaceOf(0, bundle->Landmark(0)).normal_in_pano, Eigen::Vector3d::Zero());
  for (std::uint32_t id = 1; id < bundle->num_landmarks(); ++id) {
    const MapLandmark landmark = bundle->Landmark(id);
    const MapSurface surface = bundle->SurfaceOf(id, landmark);
    const bool wall = landmark.surface_idx == 2;
    EXPECT_EQ(surface.normal_in_pano, wall ? Eigen::Vector3d::UnitX() : Eigen::Vector3d::UnitZ());
    EXPECT_NEAR(surface.distance_sigma_share, wall ? 0.03 + landmark.panorama_idx : 0.02, kFloat);
    EXPECT_NEAR(surface.normal_sigma_rad, wall ? 0.02 : 0.01, kFloat);
  }
}

TEST(MapBundle, SurfacesAreUnitOrUnknown) {
  const float kBad[] = {std::numeric_limits<float>::quiet_NaN(), -1.0F,
                        std::numeric_limits<float>::infinity()};
  // What b's ground says: n, d, share, radians.
  const auto ground = [](const std::function<void(float*)>& change) {
    const TempFolder folder;
    CraftedBundle crafted = SmallBundle();
    change(&crafted.tiles[0].planes[6 * (3 + 1)]);
    crafted.Write(folder / "b");
    const auto bundle = OpenOrFail(folder / "b");
    MapLandmark landmark;
    landmark.panorama_idx = 1, landmark.surface_idx = 1;
    return bundle ? bundle->SurfaceOf(2, landmark) : MapSurface{};
  };
  EXPECT_EQ(ground([](float*) {}).normal_in_pano, Eigen::Vector3d::UnitZ());
  EXPECT_EQ(ground([](float* p) { p[2] = 1.5F; }).normal_in_pano, Eigen::Vector3d::UnitZ());
  EXPECT_EQ(ground([](float* p) { p[2] = 0; }).normal_in_pano, Eigen::Vector3d::Zero());
  for (const float bad : kBad) {
    for (const std::size_t at : {4, 5}) {
      const MapSurface unknown = ground([&](float* p) { p[at] = bad; });
      EXPECT_EQ(unknown.normal_in_pano, Eigen::Vector3d::Zero()) << at << " " << bad;
      EXPECT_EQ(unknown.distance_sigma_share, 0) << at << " " << bad;
    }
  }
  EXPECT_EQ(ground([&](float* p) { p[0] = kBad[0]; }).normal_in_pano, Eigen::Vector3d::Zero());
}

TEST(MapBundle, TilesMayComeInAnyOrder) {
  const TempFolder folder;
  CraftedBundle crafted = SmallBundle();
  std::swap(crafted.tiles[0].path, crafted.tiles[1].path);
  crafted.Write(folder / "b");
  const auto bundle = OpenOrFail(folder / "b");
  ASSERT_TRUE(bundle);
  // Ids count by tile as it is listed; views do not care.
  for (const std::uint32_t view : {3U, 8U}) {
    const MapBundle::LandmarkList list = bundle->LandmarksOf(view);
    ASSERT_GT(list.size(), 0U);
    const MapLandmark last = bundle->Landmark(list[list.size() - 1]);
    EXPECT_EQ(last.panorama_idx, view == 3 ? 1U : 3U);
  }
}

TEST(MapBundle, PackedAndWholeDescriptorsMayMix) {
  const TempFolder folder;
  CraftedBundle crafted = SmallBundle();
  CraftedTile& tile = crafted.tiles[1];
  std::vector<std::uint8_t> packed(tile.descriptors.size() / 2);
  for (std::size_t i = 0; i < packed.size() / kPackedDescriptorSize; ++i) {
    PackDescriptor(std::span<const std::uint8_t, kDescriptorSize>(
                       &tile.descriptors[i * kDescriptorSize], kDescriptorSize),
                   &packed[i * kPackedDescriptorSize]);
  }
  const std::vector<std::uint8_t> whole = tile.descriptors;
  tile.descriptors = packed, tile.descriptor_cols = kPackedDescriptorSize;
  crafted.Write(folder / "b");
  const auto bundle = OpenOrFail(folder / "b");
  ASSERT_TRUE(bundle);
  for (std::uint32_t i = 0; i < 10; ++i) {
    std::array<std::uint8_t, kDescriptorSize> descriptor, expected;
    bundle->Descriptor(5 + i, descriptor.data());
    UnpackDescriptor(&packed[i * kPackedDescriptorSize], expected.data());
    EXPECT_EQ(descriptor, expected);
  }
}

TEST(MapBundle, ABundleWithoutLandmarksOpens) {
  const TempFolder folder;
  CraftedBundle crafted = SmallBundle();
  crafted.tiles.clear();
  CraftedTile& tile = crafted.tiles.emplace_back();
  tile.path = "tiles/0.h5";
  tile.panorama_ids = crafted.ids;
  for (int view = 0; view < 10; ++view) tile.EndView({}, {});
  crafted.Write(folder / "b");
  const auto bundle = OpenOrFail(folder / "b");
  ASSERT_TRUE(bundle);
  EXPECT_EQ(bundle->num_landmarks(), 0U);
  EXPECT_EQ(bundle->LandmarksOf(9).size(), 0U);
  EXPECT_TRUE(bundle->BagOf(9).empty());
}

// A tile without landmarks takes no id from its neighbour.
TEST(MapBundle, AnEmptyTileBeforeOthersTakesNoIds) {
  const TempFolder folder;
  CraftedBundle crafted = SmallBundle();
  CraftedTile& tile = crafted.tiles[0];
  const CraftedTile full = tile;
  tile = {};
  tile.path = full.path, tile.panorama_ids = full.panorama_ids;
  for (int view = 0; view < 6; ++view) tile.EndView({}, {});
  crafted.Write(folder / "b");
  const auto bundle = OpenOrFail(folder / "b");
  ASSERT_TRUE(bundle);
  ASSERT_EQ(bundle->num_landmarks(), 10U);
  EXPECT_EQ(bundle->Landmark(0).point_in_pano.x(), 107);
  EXPECT_EQ(bundle->Landmark(9).panorama_idx, 3U);
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
    EXPECT_EQ(bundle->LandmarksOf(3).size(), 3U);
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
  EXPECT_EQ(bundle->Landmark(3).point_in_pano.x(), 101);
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
