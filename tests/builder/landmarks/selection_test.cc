#include <gtest/gtest.h>

#include <map>
#include <stdexcept>

#include "builder/landmarks/select_landmarks.h"
#include "common/base/rng.h"

namespace panofix {
namespace {

MergedLandmark Make(int num_panoramas, std::vector<std::uint32_t> views, float response) {
  MergedLandmark m;
  m.landmark.num_panoramas = static_cast<std::uint8_t>(num_panoramas);
  m.landmark.views = std::move(views);
  m.landmark.size_m = response;  // a name to know it by
  m.response = response;
  return m;
}

std::vector<float> Names(const std::vector<Landmark>& landmarks) {
  std::vector<float> names;
  for (const Landmark& l : landmarks) names.push_back(l.size_m);
  return names;
}

TEST(Selection, PanoramasBeforeViewsBeforeResponse) {
  const std::vector<MergedLandmark> all = {Make(1, {0}, 9), Make(1, {0, 1}, 2), Make(2, {0}, 1),
                                           Make(1, {0}, 8)};
  EXPECT_EQ(Names(SelectLandmarks(all, 1)), (std::vector<float>{2, 1}));  // view 1 has only "2"
  EXPECT_EQ(Names(SelectLandmarks(all, 2)), (std::vector<float>{2, 1}));
  EXPECT_EQ(Names(SelectLandmarks(all, 3)), (std::vector<float>{9, 2, 1}));
}

TEST(Selection, ZeroKeepsAllInOrder) {
  EXPECT_EQ(Names(SelectLandmarks({Make(1, {0}, 3), Make(2, {0}, 1)}, 0)),
            (std::vector<float>{3, 1}));
  EXPECT_TRUE(SelectLandmarks({}, 5).empty());
}

TEST(Selection, AViewGetsItsQuotaWhereThereIsEnough) {
  constexpr int kQuota = 20, kNumViews = 30;
  Rng rng(1, "test/selection");
  std::vector<MergedLandmark> all;
  std::map<std::uint32_t, int> available;
  for (int i = 0; i < 3000; ++i) {
    std::vector<std::uint32_t> views;
    // The last view is shown by few.
    for (std::uint32_t v = 0; v < kNumViews; ++v) {
      if (rng.Uniform() < (v + 1 == kNumViews ? 0.003 : 0.1)) views.push_back(v);
    }
    for (const std::uint32_t v : views) ++available[v];
    all.push_back(
        Make(1 + static_cast<int>(rng.Below(3)), views, static_cast<float>(rng.Uniform())));
  }
  const std::vector<Landmark> kept = SelectLandmarks(all, kQuota);
  std::map<std::uint32_t, int> count;
  for (const Landmark& l : kept) {
    for (const std::uint32_t v : l.views) ++count[v];
  }
  for (std::uint32_t v = 0; v < kNumViews; ++v) EXPECT_GE(count[v], std::min(kQuota, available[v]));
  EXPECT_LT(available[kNumViews - 1], kQuota);  // else the case of too few is not tried
  EXPECT_LE(kept.size(), static_cast<std::size_t>(kQuota * kNumViews));
}

TEST(LandmarkOptions, BadValuesAreNamed) {
  LandmarkOptions options;
  EXPECT_NO_THROW(options.Check());
  options.max_per_view = -1;
  EXPECT_THROW(options.Check(), std::invalid_argument);
  options = {};
  options.max_merge_descriptor_distance = 0;
  EXPECT_THROW(options.Check(), std::invalid_argument);
  options = {};
  options.max_shift_m = 0;
  EXPECT_THROW(options.Check(), std::invalid_argument);
  options = {};
  options.max_turn_deg = -1;
  EXPECT_THROW(options.Check(), std::invalid_argument);
}

}  // namespace
}  // namespace panofix
