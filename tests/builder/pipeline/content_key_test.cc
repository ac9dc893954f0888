#include <gtest/gtest.h>

#include <fstream>

#include "builder/pipeline/extract_stage.h"
#include "tests/common/io/temp_folder.h"

namespace panofix {
namespace {

class ContentKeyTest : public testing::Test {
 protected:
  ContentKeyTest() {
    record_.id = "a";
    record_.image = folder_ / "a.jpg";
    record_.depth = folder_ / "a.gsv";
    Write(record_.image, "picture");
    Write(record_.depth, "depth");
  }
  static void Write(const std::filesystem::path& path, const std::string& text) {
    std::ofstream(path) << text;
  }
  [[nodiscard]] std::string Key(double hfov_deg = 60, int num_views = 8) const {
    const Rectifier rectifier(Camera::FromHorizontalFov(160, 120, hfov_deg),
                              RingOfViews(num_views, 0));
    return ContentKey(record_, rectifier, options_).Hex();
  }
  TempFolder folder_;
  PanoramaRecord record_;
  ExtractOptions options_;
};

TEST_F(ContentKeyTest, EqualInputsGiveEqualKeys) { EXPECT_EQ(Key(), Key()); }

TEST_F(ContentKeyTest, EverythingThatChangesFeaturesChangesIt) {
  std::vector<std::string> keys = {Key(), Key(61), Key(60, 9)};
  Write(record_.image, "picturf");
  keys.push_back(Key());
  Write(record_.depth, "deptg");
  keys.push_back(Key());
  record_.depth.clear();
  keys.push_back(Key());
  record_.depth_scale_m = 0.002;
  keys.push_back(Key());
  options_.features.max_sift += 1;
  keys.push_back(Key());
  options_.errors.relief_sigma_m += 0.1;
  keys.push_back(Key());
  std::sort(keys.begin(), keys.end());
  EXPECT_EQ(std::unique(keys.begin(), keys.end()), keys.end());
}

// Refined or corrected geotags do not cost an extraction.
TEST_F(ContentKeyTest, ThePoseDoesNot) {
  const std::string key = Key();
  record_.position.lat_deg += 1e-5;
  record_.attitude.heading_deg += 1;
  record_.links = {"b"};
  EXPECT_EQ(Key(), key);
}

}  // namespace
}  // namespace panofix
