// Bundles that keep their views' pictures.
#include "common/map/view_images.h"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "common/map/map_bundle.h"
#include "tests/common/features/synthetic_image.h"
#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"

namespace panofix {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr int kJpegLevels = 12;  // grey levels that JPEG of quality 95 may be off at a blob's edge

Bytes Jpeg(GrayImage image) {
  const cv::Mat mat(image.height_px, image.width_px, CV_8UC1, image.pixels.data());
  Bytes bytes;
  EXPECT_TRUE(cv::imencode(".jpg", mat, bytes, {cv::IMWRITE_JPEG_QUALITY, 95}));
  return bytes;
}

// The arrays of one images part, right until a test changes them.
struct Part {
  std::vector<std::string> ids;
  std::vector<std::uint32_t> offsets{0};
  Bytes bytes;
  void Add(const Bytes& image) {
    bytes.insert(bytes.end(), image.begin(), image.end());
    offsets.push_back(static_cast<std::uint32_t>(bytes.size()));
  }
};

class ViewImagesTest : public testing::Test {
 protected:
  // Panoramas a, b in one part, c, d in another; view v of panorama p is busy image 2 p + v.
  ViewImagesTest() : parts_(2), bundle_(SmallBundle()) {
    bundle_.manifest.camera = Camera::FromHorizontalFov(160, 120, 70);
    for (std::uint32_t p = 0; p < 4; ++p) {
      parts_[p / 2].ids.push_back(bundle_.ids[p]);
      for (std::uint32_t v = 0; v < 2; ++v) parts_[p / 2].Add(Jpeg(Image(2 * p + v)));
    }
  }
  [[nodiscard]] static GrayImage Image(std::uint32_t seed) { return BusyImage(160, 120, seed); }
  [[nodiscard]] Result<std::shared_ptr<const MapBundle>> Open() {
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      Hdf5Writer file(folder_ / "part.h5");
      file.WriteStrings("panorama_ids", parts_[i].ids);
      file.Write<std::uint32_t>("views/offsets", parts_[i].offsets);
      file.Write<std::uint8_t>("views/jpeg", parts_[i].bytes);
      file.Close();
      bundle_.extra_parts.emplace_back("images/" + std::to_string(i) + ".h5",
                                       ReadText(folder_ / "part.h5"));
    }
    bundle_.Write(folder_ / "b");
    return MapBundle::Open(folder_ / "b");
  }
  void ExpectRefused() { EXPECT_EQ(Open().status().code(), ErrorCode::kBadData); }
  TempFolder folder_;
  std::vector<Part> parts_;
  CraftedBundle bundle_;
};

TEST_F(ViewImagesTest, EveryPanoramasViewHasItsPicture) {
  const auto bundle = Open();
  ASSERT_TRUE(bundle.ok()) << bundle.status().message();
  ASSERT_TRUE((*bundle)->has_view_images());
  for (std::uint32_t p = 0; p < 4; ++p) {
    for (std::uint32_t v = 0; v < 2; ++v) {
      const auto image = (*bundle)->ViewImage(2 * (*bundle)->first_station(p) + v);
      ASSERT_TRUE(image.ok()) << image.status().message();
      const GrayImage expected = Image(2 * p + v);
      ASSERT_EQ(image->pixels.size(), expected.pixels.size());
      int worst = 0;
      for (std::size_t i = 0; i < expected.pixels.size(); ++i)
        worst = std::max(worst, std::abs(image->pixels[i] - expected.pixels[i]));
      EXPECT_LE(worst, kJpegLevels) << p << " " << v;
    }
  }
}

TEST_F(ViewImagesTest, VirtualStationsHaveNone) {
  const auto bundle = Open();
  ASSERT_TRUE(bundle.ok()) << bundle.status().message();
  for (const std::uint32_t view : {4U, 5U})  // of b's virtual station
    EXPECT_EQ((*bundle)->ViewImage(view).status().code(), ErrorCode::kNotFound);
}

TEST_F(ViewImagesTest, MostBundlesHaveNone) {
  parts_.clear();
  const auto bundle = Open();
  ASSERT_TRUE(bundle.ok()) << bundle.status().message();
  EXPECT_FALSE((*bundle)->has_view_images());
  EXPECT_EQ((*bundle)->ViewImage(0).status().code(), ErrorCode::kNotFound);
}

TEST_F(ViewImagesTest, PicturesOfSomePanoramasOnlyAreRefused) {
  parts_.pop_back();
  ExpectRefused();
}

TEST_F(ViewImagesTest, PanoramasThatComeTwiceAreRefused) {
  parts_[1].ids = parts_[0].ids;
  ExpectRefused();
}

TEST_F(ViewImagesTest, StrangersAreRefused) {
  parts_[0].ids[1] = "nobody";
  ExpectRefused();
}

TEST_F(ViewImagesTest, OffsetsOutsideTheBytesAreRefused) {
  parts_[1].offsets.back() += 1;
  ExpectRefused();
}

TEST_F(ViewImagesTest, OffsetsThatFallAreRefused) {
  std::swap(parts_[1].offsets[1], parts_[1].offsets[2]);
  ExpectRefused();
}

TEST_F(ViewImagesTest, ViewsThatLackAPictureAreRefused) {
  parts_[0].offsets.erase(parts_[0].offsets.begin() + 1);
  ExpectRefused();
}

// The hash is right, so the bundle opens: a picture is looked into when it is asked for.
TEST_F(ViewImagesTest, PicturesThatAreNoneAreSaid) {
  Part damaged;
  damaged.ids = parts_[0].ids;
  const Bytes whole = Jpeg(Image(0));
  damaged.Add(Bytes(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(whole.size() / 2)));
  damaged.Add({});
  damaged.Add(Jpeg(BusyImage(120, 160, 3)));  // not the camera's size
  damaged.Add(whole);
  parts_[0] = damaged;
  const auto bundle = Open();
  ASSERT_TRUE(bundle.ok()) << bundle.status().message();
  for (const std::uint32_t view : {0U, 1U, 2U})
    EXPECT_EQ((*bundle)->ViewImage(view).status().code(), ErrorCode::kBadData) << view;
  EXPECT_TRUE((*bundle)->ViewImage(3).ok());
}

}  // namespace
}  // namespace panofix
