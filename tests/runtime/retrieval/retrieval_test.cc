#include "runtime/retrieval/retrieval.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"
#include "tests/common/vocabulary/make_tree.h"

namespace panofix {
namespace {

constexpr std::uint32_t kPanoramas = 20, kViews = 40;

BagOfWords RandomBag(const Vocabulary& vocabulary, Rng* rng) {
  std::vector<std::uint32_t> words;
  for (int i = 0; i < 6; ++i) words.push_back(static_cast<std::uint32_t>(rng->Below(36)));
  return vocabulary.Bag(words, {});
}

// Panoramas in a row with two views each; a view's similar ones are the next five.
class RetrievalTest : public testing::Test {
 protected:
  RetrievalTest() : rng_(1, "tests/retrieval") {
    CraftedBundle crafted;
    crafted.manifest = SmallBundle().manifest;
    crafted.directions = {0, 0, 180, 0};
    crafted.vocabulary = RandomVocabulary(&rng_);
    CraftedTile& tile = crafted.tiles.emplace_back();
    tile.path = "tiles/0.h5";
    for (std::uint32_t p = 0; p < kPanoramas; ++p) {
      crafted.AddPanorama("p" + std::to_string(p),
                          {Eigen::Quaterniond::Identity(), {0, 10.0 * p, 2}}, {});
      tile.panorama_ids.push_back(crafted.ids.back());
      for (std::uint32_t v = 0; v < 2; ++v) {
        // View 7 has no words, 11 repeats 10: equals.
        const std::uint32_t view = 2 * p + v;
        if (view != 11) last_ = view == 7 ? BagOfWords{} : RandomBag(crafted.vocabulary, &rng_);
        tile.EndView(last_);
        for (std::uint32_t k = 1; k <= 5; ++k) crafted.similar.push_back((view + k) % kViews);
        crafted.similar_offsets.push_back(static_cast<std::uint32_t>(crafted.similar.size()));
      }
      tile.EndPanorama({});
    }
    crafted.Write(folder_ / "b");
    bundle_ = ValueOrThrow(MapBundle::Open(folder_ / "b"));
  }
  // Views of `candidates` by similarity, those that share no word left out.
  [[nodiscard]] std::vector<std::uint32_t> Oracle(const BagOfWords& query,
                                                  std::vector<std::uint32_t> candidates,
                                                  std::size_t count) const {
    std::erase_if(candidates,
                  [&](std::uint32_t v) { return Similarity(query, bundle_->bags()[v]) <= 0; });
    std::stable_sort(candidates.begin(), candidates.end(), [&](std::uint32_t a, std::uint32_t b) {
      return Similarity(query, bundle_->bags()[a]) > Similarity(query, bundle_->bags()[b]);
    });
    if (candidates.size() > count) candidates.resize(count);
    return candidates;
  }
  [[nodiscard]] static std::vector<std::uint32_t> IndicesOf(const RetrievalResult& result) {
    std::vector<std::uint32_t> views;
    for (const RetrievedView& view : result.views) views.push_back(view.view_idx);
    return views;
  }
  [[nodiscard]] static std::vector<std::uint32_t> All() {
    std::vector<std::uint32_t> all;
    for (std::uint32_t v = 0; v < kViews; ++v) all.push_back(v);
    return all;
  }
  TempFolder folder_;
  Rng rng_;
  BagOfWords last_;
  std::shared_ptr<const MapBundle> bundle_;
};

TEST_F(RetrievalTest, AViewFindsItself) {
  const Retrieval retrieval(bundle_);
  for (const std::uint32_t view : {0U, 10U, 39U}) {
    const RetrievalResult result = retrieval.Global(bundle_->bags()[view], 3);
    ASSERT_EQ(result.views.size(), 3U);
    EXPECT_EQ(result.views[0].view_idx, view);  // 10 before its double 11
    EXPECT_NEAR(double{result.views[0].similarity}, 1, 1e-5);
  }
}

TEST_F(RetrievalTest, GlobalIsTheOracleOverAllViews) {
  const Retrieval retrieval(bundle_);
  for (int i = 0; i < 20; ++i) {
    const BagOfWords query = RandomBag(bundle_->vocabulary(), &rng_);
    for (const int count : {1, 5, 100}) {
      const RetrievalResult result = retrieval.Global(query, count);
      EXPECT_EQ(IndicesOf(result), Oracle(query, All(), static_cast<std::size_t>(count)));
      EXPECT_EQ(result.num_compared, kViews);
      for (const RetrievedView& v : result.views) {
        EXPECT_EQ(v.similarity, Similarity(query, bundle_->bags()[v.view_idx]));
      }
    }
  }
}

TEST_F(RetrievalTest, WindowedIsTheOracleOverTheRows) {
  const Retrieval retrieval(bundle_);
  for (int i = 0; i < 20; ++i) {
    const BagOfWords query = RandomBag(bundle_->vocabulary(), &rng_);
    const std::vector<std::uint32_t> around{3, 4, static_cast<std::uint32_t>(rng_.Below(kViews)),
                                            3};
    std::set<std::uint32_t> window(around.begin(), around.end());
    for (const std::uint32_t view : around) {
      for (std::uint32_t k = 1; k <= 5; ++k) window.insert((view + k) % kViews);
    }
    const RetrievalResult result = retrieval.Windowed(query, around, 6);
    EXPECT_EQ(IndicesOf(result), Oracle(query, {window.begin(), window.end()}, 6));
    EXPECT_EQ(result.num_compared, static_cast<std::int64_t>(window.size()));
  }
}

// A window of everything is the global search, to the last bit.
TEST_F(RetrievalTest, WindowedOverAllIsGlobal) {
  const Retrieval retrieval(bundle_);
  const BagOfWords query = RandomBag(bundle_->vocabulary(), &rng_);
  const RetrievalResult global = retrieval.Global(query, 40),
                        windowed = retrieval.Windowed(query, All(), 40);
  ASSERT_EQ(IndicesOf(global), IndicesOf(windowed));
  for (std::size_t i = 0; i < global.views.size(); ++i) {
    EXPECT_EQ(global.views[i].similarity, windowed.views[i].similarity);
  }
}

TEST_F(RetrievalTest, NothingAskedNothingFound) {
  const Retrieval retrieval(bundle_);
  const BagOfWords query = RandomBag(bundle_->vocabulary(), &rng_);
  EXPECT_TRUE(retrieval.Global({}, 5).views.empty());
  EXPECT_TRUE(retrieval.Global(query, 0).views.empty());
  EXPECT_TRUE(retrieval.Global(query, -3).views.empty());
  EXPECT_TRUE(retrieval.Windowed(query, {}, 5).views.empty());
  EXPECT_EQ(retrieval.Windowed(query, {}, 5).num_compared, 0);
  EXPECT_TRUE(retrieval.Windowed({}, All(), 5).views.empty());
}

}  // namespace
}  // namespace panofix
