#include "runtime/retrieval/tile_indices.h"

#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <thread>

#include "common/base/log.h"
#include "runtime/retrieval/retrieval.h"
#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"

namespace panofix {
namespace {

// A bound that no tile fits in.
constexpr std::uint64_t kNothing_bytes = 1;

// Two tiles, a kilometre apart.
class TileIndicesTest : public testing::Test {
 protected:
  void SetUp() override {
    SetLogLevel("off");
    CraftedBundle crafted = SmallBundle();
    for (const std::size_t p : {2, 3}) crafted.positions[3 * p + 1] += 1000;
    crafted.Write(folder_ / "b");
    bundle_ = Open();
    for (std::size_t tile = 0; tile < 2; ++tile) both_bytes_ += bundle_->tiles().num_bytes(tile);
  }
  [[nodiscard]] std::shared_ptr<const MapBundle> Open() const {
    return ValueOrThrow(MapBundle::Open(folder_ / "b"));
  }
  [[nodiscard]] std::vector<float> Scores(const std::shared_ptr<const MapBundle>& bundle,
                                          std::uint64_t max_memory_bytes) const {
    RetrievalOptions options;
    options.num_views = 100, options.max_views_per_panorama = 100;
    options.max_memory_bytes = max_memory_bytes;
    const Retrieval retrieval(bundle, options);
    std::vector<float> scores;
    const FeatureSet no_features;
    for (std::size_t v = 0; v < bundle_->views().size(); ++v) {
      const BagOfWords bag = bundle_->BagOf(v);
      const auto found = retrieval.Global({bag, no_features, {}, bundle_->manifest().camera, {}});
      for (const RetrievedView& view : found.views) {
        scores.push_back(static_cast<float>(view.view_idx));
        scores.push_back(view.similarity);
      }
    }
    return scores;
  }
  [[nodiscard]] std::filesystem::path TileFile(const char* name) const {
    return folder_ / "b" / "tiles" / name;
  }

  const TempFolder folder_;
  std::shared_ptr<const MapBundle> bundle_;
  std::uint64_t both_bytes_ = 0;
};

template <typename Condition>
bool Eventually(Condition condition) {
  for (int i = 0; i < 20'000; ++i) {
    if (condition()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return false;
}

TEST_F(TileIndicesTest, AnswersDoNotDependOnTheBound) {
  const auto bounded = Open();
  const std::vector<float> expected = Scores(bundle_, 0);
  ASSERT_FALSE(expected.empty());
  EXPECT_EQ(Scores(bounded, kNothing_bytes), expected);
  EXPECT_EQ(bundle_->tiles().num_loads(), 2);
  EXPECT_GT(bounded->tiles().num_loads(), 20);  // each search reads them again
  EXPECT_EQ(bounded->tiles().num_loaded_bytes(), 0U);
}

TEST_F(TileIndicesTest, WhatIsAheadIsLoadedAndWhatIsBehindDropped) {
  // One tile fits, not both; what indices take is told by `memory_beside_tiles` as a rule.
  TileIndices indices(bundle_, true, both_bytes_ - 1, [] { return std::uint64_t{0}; });
  const auto drive = [&](double y_m, double ahead_y_m) {
    indices.Follow({0, y_m, 0}, {0, ahead_y_m, 0});
    indices.Trim();
  };
  drive(0, 200);
  EXPECT_TRUE(Eventually([&] { return bundle_->tiles().IsLoaded(0); }));
  EXPECT_FALSE(bundle_->tiles().IsLoaded(1));
  // On its way, the next one is there before it is.
  drive(700, 950);
  EXPECT_TRUE(Eventually([&] { return bundle_->tiles().IsLoaded(1); }));
  EXPECT_TRUE(Eventually([&] {
    drive(1010, 1020);
    return !bundle_->tiles().IsLoaded(0);
  }));
  EXPECT_TRUE(bundle_->tiles().IsLoaded(1));
  EXPECT_LT(bundle_->tiles().num_loaded_bytes(), both_bytes_);
  EXPECT_EQ(indices.memory().num_loaded, 1);
}

TEST_F(TileIndicesTest, WhatWouldBeDroppedAgainIsNotLoadedAhead) {
  // Half of a tile fits.
  constexpr std::uint64_t kBound_bytes = std::uint64_t{1} << 40;
  const std::uint64_t beside_bytes = kBound_bytes - bundle_->tiles().num_bytes(0) / 2;
  TileIndices indices(bundle_, true, kBound_bytes, [=] { return beside_bytes; });
  const std::int64_t num_loads = bundle_->tiles().num_loads();
  for (int i = 0; i < 50; ++i) {
    indices.Follow({0, 0, 0}, {0, 1, 0});
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    indices.Trim();
  }
  EXPECT_EQ(bundle_->tiles().num_loads(), num_loads);
}

TEST_F(TileIndicesTest, ABoundThatCannotHoldIsToldOnce) {
  SetLogLevel("warning");
  testing::internal::CaptureStderr();
  TileIndices indices(bundle_, true, 1, [] { return std::uint64_t{5} << 20; });
  indices.Trim();
  const std::string log = testing::internal::GetCapturedStderr();
  SetLogLevel("off");
  const auto at = log.find("the bound does not hold");
  ASSERT_NE(at, std::string::npos) << log;
  EXPECT_EQ(log.find("the bound does not hold", at + 1), std::string::npos) << log;
}

TEST_F(TileIndicesTest, ADeletedFileIsReadOn) {
  const std::vector<float> expected = Scores(bundle_, 0);
  std::filesystem::remove_all(folder_ / "b");
  EXPECT_EQ(Scores(bundle_, kNothing_bytes), expected);
  EXPECT_EQ(bundle_->tiles().num_failed(), 0);
}

TEST_F(TileIndicesTest, AFileThatIsCutCostsItsTileOnlyOnceItIsDropped) {
  const std::size_t view = 9;  // of the second tile
  const MapBundle::LandmarkList landmarks = bundle_->LandmarksOf(view);
  ASSERT_GT(landmarks.size(), 0U);
  const std::uint32_t id = landmarks[0];
  const std::vector<float> expected = Scores(bundle_, 0);
  std::filesystem::resize_file(TileFile("1.h5"), std::filesystem::file_size(TileFile("1.h5")) / 2);
  EXPECT_EQ(Scores(bundle_, 0), expected);
  bundle_->tiles().Drop(1);
  EXPECT_EQ(bundle_->LandmarksOf(view).size(), 0U);
  EXPECT_TRUE(bundle_->BagOf(view).empty());
  EXPECT_EQ(bundle_->Landmark(id).surface_idx, 0);  // an id from before does no harm
  EXPECT_EQ(bundle_->tiles().num_failed(), 1);
  EXPECT_GT(bundle_->LandmarksOf(0).size(), 0U);
  EXPECT_NE(Scores(bundle_, 0), expected);
  EXPECT_EQ(bundle_->tiles().num_failed(), 1);  // and is not tried again and again
}

TEST_F(TileIndicesTest, AFileThatIsChangedIsNotUsed) {
  bundle_->tiles().Drop(0);
  std::fstream file(TileFile("0.h5"), std::ios::in | std::ios::out | std::ios::binary);
  const auto middle = static_cast<std::streamoff>(std::filesystem::file_size(TileFile("0.h5")) / 2);
  file.seekg(middle);
  const int old = file.get();
  file.seekp(middle);
  file.put(static_cast<char>(old ^ 1));
  file.close();
  EXPECT_EQ(bundle_->LandmarksOf(0).size(), 0U);
  EXPECT_EQ(bundle_->tiles().num_failed(), 1);
}

}  // namespace
}  // namespace panofix
