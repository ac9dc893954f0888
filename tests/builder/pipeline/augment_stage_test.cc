#include "builder/pipeline/augment_stage.h"

#include <gtest/gtest.h>

#include <functional>
#include <numeric>
#include <opencv2/imgcodecs.hpp>

#include "common/base/cancel.h"
#include "tests/builder/extract/box_world.h"
#include "tests/common/features/synthetic_image.h"
#include "tests/common/io/temp_folder.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

std::size_t NumStations(const AugmentStageResult& result) {
  std::size_t num = 0;
  for (const auto& stations : result.stations) num += stations.size() - 1;
  return num;
}

// Five panoramas in a row, 6 m apart, each linked to the next; what they show is of no matter.
class AugmentStageTest : public testing::Test {
 public:  // changes are made from outside
  AugmentStageTest() : rectifier_(Camera::FromHorizontalFov(120, 90, 80), RingOfViews(2, 0)) {
    GrayImage image = BusyImage(480, 240, 1);
    const cv::Mat view(image.height_px, image.width_px, CV_8UC1, image.pixels.data());
    EXPECT_TRUE(cv::imwrite((folder_ / "p.png").string(), view));
    WriteText(folder_ / "p.gsv", Room::Gsv());
    for (int p = 0; p < 5; ++p) {
      ExtractedPanorama panorama;
      panorama.record.id = std::string(1, static_cast<char>('a' + p));
      panorama.record.image = folder_ / "p.png", panorama.record.depth = folder_ / "p.gsv";
      panorama.record.position = {48.85 + 6.0 * p / 111200, 2.335, 35};
      if (p < 4) panorama.record.links = {std::string(1, static_cast<char>('b' + p))};
      panorama.content_key = "key of " + panorama.record.id;
      panorama.has_depth = true;
      panoramas_.push_back(panorama);
    }
    stations_.spacing_m = 3;
    stations_.beyond_m = 0;
    options_.max_sift = 100;
  }
  [[nodiscard]] AugmentStageResult Run() const {
    std::vector<std::uint32_t> own(panoramas_.size());
    std::iota(own.begin(), own.end(), 0U);
    return AugmentStage(panoramas_, own, rectifier_, stations_, options_, work_, nullptr);
  }
  // Keys of the stations' files after a change, which is undone.
  std::vector<std::string> KeysAfter(const std::function<void(AugmentStageTest*)>& change) {
    const auto panoramas = panoramas_;
    const auto stations = stations_;
    const auto options = options_;
    change(this);
    const std::vector<std::string> keys = Run().keys;
    panoramas_ = panoramas, stations_ = stations, options_ = options;
    return keys;
  }
  [[nodiscard]] fs::path File(const std::string& key) const {
    return work_.Content("stations", key);
  }
  TempFolder folder_;
  WorkFolder work_{folder_ / "work"};
  Rectifier rectifier_;
  std::vector<ExtractedPanorama> panoramas_;
  StationOptions stations_;
  StationExtractOptions options_;
};

TEST_F(AugmentStageTest, StationsStandAlongTheLinks) {
  const AugmentStageResult result = Run();
  ASSERT_EQ(result.stations.size(), 5U);
  // Half-way of each link, owned by the lower id: the last panorama has none.
  EXPECT_EQ(NumStations(result), 4U);
  EXPECT_EQ(result.made, (std::vector<std::uint32_t>{0, 1, 2, 3}));
  for (std::uint32_t p = 0; p < 5; ++p) {
    ASSERT_EQ(result.stations[p].size(), p < 4 ? 2U : 1U);
    for (const Station& station : result.stations[p]) EXPECT_EQ(station.panorama_idx, p);
    EXPECT_EQ(result.stations[p][0].position_in_pano, Eigen::Vector3d::Zero());
    EXPECT_EQ(result.keys[p].empty(), p == 4);
    if (p == 4) continue;
    EXPECT_NEAR(result.stations[p][1].position_in_pano.y(), 3, 0.02);
    const auto features = ReadPanoramaFeatures(File(result.keys[p]));
    ASSERT_TRUE(features.ok()) << features.status().message();
    EXPECT_EQ(features->views.size(), 2U);
    ASSERT_FALSE(features->sources.empty());
    EXPECT_EQ(features->sources[0], panoramas_[p].record.id);
  }
}

TEST_F(AugmentStageTest, AnotherRunReusesWhatIsThere) {
  const AugmentStageResult first = Run();
  fs::remove(File(first.keys[1]));
  WriteText(File(first.keys[2]), "half of a fi");  // of a killed program's disk
  const AugmentStageResult second = Run();
  EXPECT_EQ(second.made, (std::vector<std::uint32_t>{1, 2}));
  EXPECT_EQ(second.keys, first.keys);
  EXPECT_TRUE(Run().made.empty());
}

TEST_F(AugmentStageTest, AStoppedRunResumes) {
  RequestCancel();
  try {
    (void)Run();
    ADD_FAILURE() << "nothing was thrown";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::kCancelled);
  }
  ClearCancel();
  EXPECT_EQ(NumStations(Run()), 4U);
}

// A panorama's stations depend on itself and two links around.
TEST_F(AugmentStageTest, AFarPanoramaChangesNothingHere) {
  const std::vector<std::string> before = Run().keys;
  const auto expect_changed = [&](const std::vector<std::string>& after, const char* what) {
    EXPECT_EQ(after[0], before[0]) << what;
    EXPECT_EQ(after[1], before[1]) << what;
    EXPECT_NE(after[2], before[2]) << what;
    EXPECT_NE(after[3], before[3]) << what;
  };
  expect_changed(KeysAfter([](auto* t) { t->panoramas_[4].content_key = "other"; }), "picture");
  expect_changed(KeysAfter([](auto* t) { t->panoramas_[4].record.position.lat_deg += 1e-7; }),
                 "position");
  expect_changed(KeysAfter([](auto* t) { t->panoramas_[4].record.attitude.heading_deg = 1; }),
                 "heading");
}

TEST_F(AugmentStageTest, EveryOptionThatChangesFeaturesChangesTheKey) {
  std::vector<std::string> keys = {Run().keys[1]};
  const auto add = [&](const std::function<void(AugmentStageTest*)>& change) {
    keys.push_back(KeysAfter(change)[1]);
  };
  add([](auto* t) { t->stations_.spacing_m = 2; });
  add([](auto* t) { t->stations_.lanes_m = {0, 2}; });
  add([](auto* t) { t->options_.max_sift += 1; });
  add([](auto* t) { t->options_.max_sources = 1; });
  add([](auto* t) { t->options_.max_distance_m = 5; });
  add([](auto* t) { t->options_.min_coverage = 0.1; });
  add([](auto* t) { t->options_.render.max_stretch = 2; });
  add([](auto* t) { t->options_.render.good_stretch = 1.2; });
  add([](auto* t) { t->options_.render.max_incidence_deg = 70; });
  add([](auto* t) { t->options_.render.max_range_m = 50; });
  std::sort(keys.begin(), keys.end());
  EXPECT_EQ(std::unique(keys.begin(), keys.end()), keys.end());
}

TEST_F(AugmentStageTest, WithoutDepthThereAreStationsWithoutFeatures) {
  for (ExtractedPanorama& panorama : panoramas_) panorama.has_depth = false;
  const AugmentStageResult result = Run();
  EXPECT_EQ(NumStations(result), 4U);
  const auto features = ReadPanoramaFeatures(File(result.keys[0]));
  ASSERT_TRUE(features.ok()) << features.status().message();
  ASSERT_EQ(features->views.size(), 2U);
  EXPECT_EQ(features->views[0].sift.size(), 0U);
  EXPECT_TRUE(features->sources.empty());
}

TEST_F(AugmentStageTest, NoSpacingNoStations) {
  stations_.spacing_m = 0;
  const AugmentStageResult result = Run();
  EXPECT_EQ(NumStations(result), 0U);
  for (std::size_t p = 0; p < 5; ++p) {
    EXPECT_EQ(result.stations[p].size(), 1U);
    EXPECT_TRUE(result.keys[p].empty());
  }
  EXPECT_FALSE(fs::exists(folder_ / "work"));
  panoramas_.clear();
  stations_.spacing_m = 3;
  EXPECT_TRUE(Run().stations.empty());
}

}  // namespace
}  // namespace panofix
