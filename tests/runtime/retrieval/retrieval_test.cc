#include "runtime/retrieval/retrieval.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <optional>
#include <set>

#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"
#include "tests/common/vocabulary/make_tree.h"

namespace panofix {
namespace {

constexpr std::uint32_t kPanoramas = 20, kViews = 54;

BagOfWords RandomBag(const Vocabulary& vocabulary, Rng* rng) {
  std::vector<std::uint32_t> words;
  for (int i = 0; i < 6; ++i) words.push_back(static_cast<std::uint32_t>(rng->Below(36)));
  return vocabulary.Bag(words, {});
}

// Panoramas in a row with two views a station, every third with a virtual station; a panorama's
// similar views are those of the next five in its direction.
class RetrievalTest : public testing::Test {
 protected:
  RetrievalTest() : rng_(1, "tests/retrieval") {
    CraftedBundle crafted;
    crafted.manifest = SmallBundle().manifest;
    crafted.directions = {0, 0, 180, 0};
    crafted.vocabulary = RandomVocabulary(&rng_);
    CraftedTile& tile = crafted.tiles.emplace_back();
    tile.path = "tiles/0.h5";
    std::vector<std::uint32_t> first_view;
    for (std::uint32_t p = 0; p < kPanoramas; ++p) {
      first_view.push_back(2 * static_cast<std::uint32_t>(crafted.station_panoramas.size()));
      crafted.AddPanorama("p" + std::to_string(p),
                          {Eigen::Quaterniond::Identity(), {0, 10.0 * p, 2}}, {});
      if (p % 3 == 0) crafted.AddStation({0, 4, 0});
    }
    tile.panorama_ids = crafted.ids;
    for (std::uint32_t view = 0; view < kViews; ++view) {
      // View 7 has no words, 11 repeats 10: equals.
      if (view != 11) last_ = view == 7 ? BagOfWords{} : RandomBag(crafted.vocabulary, &rng_);
      tile.EndView({}, last_);
    }
    for (std::uint32_t p = 0; p < kPanoramas; ++p) {
      for (std::uint32_t v = 0; v < 2; ++v) {
        for (std::uint32_t k = 1; k <= 5; ++k)
          crafted.similar.push_back(first_view[(p + k) % kPanoramas] + v);
        crafted.similar_offsets.push_back(static_cast<std::uint32_t>(crafted.similar.size()));
      }
    }
    crafted.Write(folder_ / "b");
    bundle_ = ValueOrThrow(MapBundle::Open(folder_ / "b"));
  }
  [[nodiscard]] std::uint32_t PanoramaOf(std::uint32_t view) const {
    return bundle_->views()[view].panorama_idx;
  }
  // Views of `panoramas` by similarity, those that share no word left out.
  [[nodiscard]] std::vector<std::uint32_t> Oracle(const BagOfWords& query,
                                                  const std::set<std::uint32_t>& panoramas,
                                                  const RetrievalOptions& options) const {
    std::vector<std::uint32_t> candidates;
    for (std::uint32_t v = 0; v < kViews; ++v) {
      if (panoramas.count(PanoramaOf(v)) > 0 && Similarity(query, bundle_->BagOf(v)) > 0)
        candidates.push_back(v);
    }
    std::stable_sort(candidates.begin(), candidates.end(), [&](std::uint32_t a, std::uint32_t b) {
      return Similarity(query, bundle_->BagOf(a)) > Similarity(query, bundle_->BagOf(b));
    });
    std::vector<std::uint32_t> kept;
    std::map<std::uint32_t, int> taken;
    for (const std::uint32_t view : candidates) {
      if (static_cast<int>(kept.size()) < options.num_views &&
          taken[PanoramaOf(view)]++ < options.max_views_per_panorama) {
        kept.push_back(view);
      }
    }
    return kept;
  }
  [[nodiscard]] static std::vector<std::uint32_t> IndicesOf(const RetrievalResult& result) {
    std::vector<std::uint32_t> views;
    for (const RetrievedView& view : result.views) views.push_back(view.view_idx);
    return views;
  }
  // 0, 1, ..., count - 1.
  [[nodiscard]] static std::vector<std::uint32_t> UpTo(std::uint32_t count) {
    std::vector<std::uint32_t> all;
    for (std::uint32_t i = 0; i < count; ++i) all.push_back(i);
    return all;
  }
  [[nodiscard]] static std::set<std::uint32_t> AllPanoramas() {
    const std::vector<std::uint32_t> all = UpTo(kPanoramas);
    return {all.begin(), all.end()};
  }
  // By bags of words alone.
  [[nodiscard]] Retrieval With(int num_views, int max_views_per_panorama) const {
    return Retrieval(bundle_, Options(num_views, max_views_per_panorama));
  }
  [[nodiscard]] static RetrievalOptions Options(int num_views, int max_views_per_panorama) {
    RetrievalOptions options;
    options.num_views = num_views, options.max_views_per_panorama = max_views_per_panorama;
    options.use_landmarks = false;
    return options;
  }
  [[nodiscard]] RetrievalQuery Query(const BagOfWords& bag) const {
    return {bag, no_features_, {}, bundle_->manifest().camera, {}};
  }
  TempFolder folder_;
  const FeatureSet no_features_;
  Rng rng_;
  BagOfWords last_;
  std::shared_ptr<const MapBundle> bundle_;
};

TEST_F(RetrievalTest, AViewFindsItself) {
  const Retrieval retrieval = With(3, 4);
  for (const std::uint32_t view : {0U, 10U, 53U}) {
    const RetrievalResult result = retrieval.Global(Query(bundle_->BagOf(view)));
    ASSERT_EQ(result.views.size(), 3U);
    EXPECT_EQ(result.views[0].view_idx, view);  // 10 before its double 11
    EXPECT_NEAR(double{result.views[0].similarity}, 1, 1e-5);
  }
}

TEST_F(RetrievalTest, GlobalIsTheOracleOverAllViews) {
  for (const auto& [num_views, most] : {std::pair{1, 4}, {5, 4}, {5, 1}, {100, 2}, {100, 100}}) {
    const Retrieval retrieval = With(num_views, most);
    for (int i = 0; i < 10; ++i) {
      const BagOfWords query = RandomBag(bundle_->vocabulary(), &rng_);
      const RetrievalResult result = retrieval.Global(Query(query));
      EXPECT_EQ(IndicesOf(result), Oracle(query, AllPanoramas(), Options(num_views, most)));
      EXPECT_EQ(result.num_compared, kViews);
      for (const RetrievedView& v : result.views) {
        EXPECT_EQ(v.similarity, Similarity(query, bundle_->BagOf(v.view_idx)));
      }
    }
  }
}

TEST_F(RetrievalTest, GlobalTellsEachPanoramasBest) {
  const BagOfWords query = RandomBag(bundle_->vocabulary(), &rng_);
  std::vector<float> best{1, 2, 3};  // what was there goes
  (void)With(1, 1).Global(Query(query), &best);
  std::vector<float> expected(kPanoramas, 0);
  for (std::uint32_t v = 0; v < kViews; ++v) {
    expected[PanoramaOf(v)] =
        std::max(expected[PanoramaOf(v)], Similarity(query, bundle_->BagOf(v)));
  }
  EXPECT_EQ(best, expected);
}

TEST_F(RetrievalTest, WindowedIsTheOracleOverTheRowsPanoramasAndThePlaces) {
  for (int i = 0; i < 20; ++i) {
    const BagOfWords query = RandomBag(bundle_->vocabulary(), &rng_);
    const std::vector<std::uint32_t> around{3, 4, static_cast<std::uint32_t>(rng_.Below(kViews)),
                                            3};
    const std::vector<std::uint32_t> places{static_cast<std::uint32_t>(rng_.Below(kPanoramas)), 15};
    std::set<std::uint32_t> window(places.begin(), places.end());
    for (const std::uint32_t view : around) {
      for (std::uint32_t k = 0; k <= 5; ++k) window.insert((PanoramaOf(view) + k) % kPanoramas);
    }
    const RetrievalResult result = With(6, 1 + i % 3).Windowed(Query(query), around, places);
    EXPECT_EQ(IndicesOf(result), Oracle(query, window, Options(6, 1 + i % 3)));
    std::int64_t num_views = 0;
    for (std::uint32_t v = 0; v < kViews; ++v) num_views += window.count(PanoramaOf(v)) > 0 ? 1 : 0;
    EXPECT_EQ(result.num_compared, num_views);
  }
}

// A window of everything is the global search, to the last bit.
TEST_F(RetrievalTest, WindowedOverAllIsGlobal) {
  const Retrieval retrieval = With(40, 3);
  const BagOfWords query = RandomBag(bundle_->vocabulary(), &rng_);
  const RetrievalResult global = retrieval.Global(Query(query));
  for (const RetrievalResult& windowed : {retrieval.Windowed(Query(query), UpTo(kViews), {}),
                                          retrieval.Windowed(Query(query), {}, UpTo(kPanoramas)),
                                          retrieval.InRows(Query(query), UpTo(kViews), true),
                                          retrieval.InRows(Query(query), {}, true)}) {
    ASSERT_EQ(IndicesOf(global), IndicesOf(windowed));
    for (std::size_t i = 0; i < global.views.size(); ++i) {
      EXPECT_EQ(global.views[i].similarity, windowed.views[i].similarity);
    }
  }
}

// The paper's: the most similar view of the rows, then its own row.
TEST_F(RetrievalTest, InRowsIsTheBestAndItsRow) {
  const Retrieval retrieval = With(6, 4);
  for (int i = 0; i < 20; ++i) {
    const BagOfWords query = RandomBag(bundle_->vocabulary(), &rng_);
    const auto around = static_cast<std::uint32_t>(rng_.Below(kViews));
    // Views of the panoramas' stations in the direction of the view around.
    std::optional<std::uint32_t> best;
    std::int64_t num_views = 0;
    for (std::uint32_t v = around % 2; v < kViews; v += 2) {
      if ((PanoramaOf(v) + kPanoramas - PanoramaOf(around)) % kPanoramas > 5) continue;
      ++num_views;
      const float similarity = Similarity(query, bundle_->BagOf(v));
      if (similarity > (best ? Similarity(query, bundle_->BagOf(*best)) : 0.0F)) best = v;
    }
    const RetrievalResult result =
        retrieval.InRows(Query(query), std::vector<std::uint32_t>{around}, false);
    EXPECT_EQ(result.num_compared, num_views);
    std::vector<std::uint32_t> expected;
    if (best) {
      expected.push_back(*best);
      const auto row = bundle_->SimilarViews(*best);
      expected.insert(expected.end(), row.begin(), row.end());  // five, fewer than k - 1
    }
    EXPECT_EQ(IndicesOf(result), expected);
  }
}

TEST_F(RetrievalTest, NothingAskedNothingFound) {
  const BagOfWords query = RandomBag(bundle_->vocabulary(), &rng_), empty;
  EXPECT_TRUE(With(5, 4).Global(Query(empty)).views.empty());
  EXPECT_TRUE(With(0, 4).Global(Query(query)).views.empty());
  EXPECT_TRUE(With(5, 0).Global(Query(query)).views.empty());
  EXPECT_TRUE(With(5, 4).Windowed(Query(query), {}, {}).views.empty());
  EXPECT_EQ(With(5, 4).Windowed(Query(query), {}, {}).num_compared, 0);
  EXPECT_TRUE(With(5, 4).Windowed(Query(empty), UpTo(kViews), {}).views.empty());
  EXPECT_TRUE(With(5, 4).InRows(Query(empty), UpTo(kViews), false).views.empty());
}

TEST_F(RetrievalTest, NegativeCountsFindNothing) {
  const BagOfWords query = RandomBag(bundle_->vocabulary(), &rng_);
  EXPECT_TRUE(With(-3, 4).Global(Query(query)).views.empty());
  EXPECT_TRUE(With(5, -3).Global(Query(query)).views.empty());
}

}  // namespace
}  // namespace panofix
