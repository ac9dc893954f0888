// What the writer puts into a tile is what a reader finds there.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <map>
#include <set>

#include "common/map/landmark_codes.h"
#include "tests/builder/publish/bundle_content.h"
#include "tests/common/io/temp_folder.h"

namespace panofix {
namespace {

constexpr double kHalfStep = 0.021;  // relative, of a length's code: half of its 4 %, and a little

// What is read equals what was written, within half a step of the codes.
void ExpectSame(const MapBundle& bundle, std::uint32_t id, const Landmark& written,
                bool is_packed) {
  const MapLandmark read = bundle.Landmark(id);
  EXPECT_EQ(read.panorama_idx, written.panorama);
  EXPECT_EQ(read.point_in_pano, written.point_in_pano.cast<double>());
  EXPECT_NEAR(read.range_sigma_m / double{written.range_sigma_m}, 1, kHalfStep);
  EXPECT_NEAR(read.point_sigma_m / double{written.point_sigma_m}, 1, kHalfStep);
  EXPECT_NEAR(read.size_m / double{written.size_m}, 1, kHalfStep);
  EXPECT_LE(std::abs(std::remainder(read.angle_deg - double{written.angle_deg}, 360)),
            0.501 * 360 / 256);
  EXPECT_EQ(read.surface_idx, written.surface_idx);
  EXPECT_EQ(read.num_panoramas, written.num_panoramas);
  const MapSurface surface = bundle.SurfaceOf(id, read);
  EXPECT_EQ(surface.normal_in_pano, Eigen::Vector3d(0, 0, -1));
  EXPECT_NEAR(surface.distance_sigma_share, 0.01 * (1 + written.panorama), 1e-8);
  EXPECT_NEAR(surface.normal_sigma_rad, 0.002, 1e-9);
  std::array<std::uint8_t, kDescriptorSize> descriptor;
  bundle.Descriptor(id, descriptor.data());
  for (std::size_t i = 0; i < kDescriptorSize; ++i) {
    ASSERT_LE(std::abs(descriptor[i] - written.descriptor[i]), is_packed ? kDescriptorStep / 2 : 0);
  }
}

TEST(BundleParts, TilesOpenAsTheyWereWritten) {
  for (const bool is_packed : {true, false}) {
    const TempFolder folder;
    BundleContent content = Content();
    content.pack_descriptors = is_packed;
    (void)Publish(folder / "b", content, GivenTile);
    const auto opened = MapBundle::Open(folder / "b");
    ASSERT_TRUE(opened.ok()) << opened.status().message();
    const MapBundle& bundle = **opened;
    std::uint32_t first_id = 0;
    for (const auto& [begin, end] : {std::pair<std::size_t, std::size_t>{0, 2}, {2, 5}}) {
      const BundleTile written = TileOf(begin, end);
      std::map<std::uint32_t, std::vector<std::uint32_t>> of_view;
      for (std::uint32_t i = 0; i < written.landmarks.size(); ++i) {
        ExpectSame(bundle, first_id + i, written.landmarks[i], is_packed);
        for (const std::uint32_t view : written.landmarks[i].views)
          of_view[view].push_back(first_id + i);
      }
      for (std::uint32_t view = 2 * kFirstStation[begin]; view < 2 * kFirstStation[end]; ++view) {
        std::vector<std::uint32_t> shown;
        const MapBundle::LandmarkList list = bundle.LandmarksOf(view);
        for (std::size_t i = 0; i < list.size(); ++i) shown.push_back(list[i]);
        EXPECT_EQ(shown, of_view[view]) << view;
        ASSERT_EQ(bundle.BagOf(view).size(), 2U);
        EXPECT_EQ(bundle.BagOf(view)[0].word, view);
        // Eight bits a weight.
        EXPECT_NEAR(double{bundle.BagOf(view)[0].weight}, 0.6, 0.5 / 255);
      }
      first_id += static_cast<std::uint32_t>(written.landmarks.size());
    }
    EXPECT_EQ(bundle.num_landmarks(), first_id);
  }
}

// A reader that derives them must find the same: from descriptors and centroids as stored.
TEST(BundleParts, WordsOfLandmarksAreThoseOfTheStoredDescriptors) {
  for (const bool is_packed : {true, false}) {
    const TempFolder folder;
    BundleContent content = Content();
    content.pack_descriptors = is_packed;
    (void)Publish(folder / "b", content, GivenTile);
    const auto opened = MapBundle::Open(folder / "b");
    ASSERT_TRUE(opened.ok()) << opened.status().message();
    const MapBundle& bundle = **opened;
    std::set<std::uint32_t> different;
    for (std::size_t t = 0; t < bundle.tiles().size(); ++t) {
      const MapTile& tile = bundle.tiles().Get(t);
      ASSERT_EQ(tile.words().size(), tile.num_landmarks());
      for (std::size_t i = 0; i < tile.num_landmarks(); ++i) {
        std::array<std::uint8_t, kDescriptorSize> descriptor;
        tile.Descriptor(i, descriptor.data());
        EXPECT_EQ(tile.words()[i], bundle.vocabulary().sift.Quantize(descriptor.data()));
        different.insert(tile.words()[i]);
      }
    }
    EXPECT_GT(different.size(), 4U);
  }
}

}  // namespace
}  // namespace panofix
