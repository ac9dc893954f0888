#include "builder/similarity/similarity_index.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>

#include "tests/common/vocabulary/make_tree.h"

namespace panofix {
namespace {

constexpr std::uint32_t kViewsPerPanorama = 4;

struct World {
  std::vector<BagOfWords> bags;
  std::vector<std::uint32_t> panorama_of_view;
  std::vector<std::vector<std::uint32_t>> neighbourhoods;
};

// Random bags; panoramas in a row see those up to `reach` away.
World MakeWorld(std::uint32_t num_panoramas = 25, std::uint32_t reach = 3) {
  Rng rng(1, "tests/similarity");
  const Vocabulary vocabulary = RandomVocabulary(&rng);
  World world;
  for (std::uint32_t p = 0; p < num_panoramas; ++p) {
    for (std::uint32_t v = 0; v < kViewsPerPanorama; ++v) {
      std::vector<std::uint32_t> words;
      for (int i = 0; i < 8; ++i) words.push_back(static_cast<std::uint32_t>(rng.Below(36)));
      world.bags.push_back(vocabulary.Bag(words, {}));
      world.panorama_of_view.push_back(p);
    }
    auto& near = world.neighbourhoods.emplace_back();
    for (std::uint32_t q = 0; q < num_panoramas; ++q) {
      if (std::max(p, q) - std::min(p, q) <= reach) near.push_back(q);
    }
  }
  world.bags[30] = world.bags[31];  // equals
  world.bags[40] = {};
  return world;
}

SimilarityIndex Build(const World& world, int num_similar) {
  SimilarityOptions options;
  options.num_similar = num_similar;
  return SimilarityRows(world.bags, world.panorama_of_view, world.neighbourhoods, options, 0,
                        world.bags.size());
}

// Every row against all views compared one by one.
void ExpectBruteForce(const World& world, int num_similar) {
  const SimilarityIndex index = Build(world, num_similar);
  ASSERT_EQ(index.offsets.size(), world.bags.size() + 1);
  ASSERT_EQ(index.views.size(), index.offsets.back());
  ASSERT_EQ(index.similarity.size(), index.views.size());
  for (std::uint32_t v = 0; v < world.bags.size(); ++v) {
    const auto& near = world.neighbourhoods[world.panorama_of_view[v]];
    std::vector<bool> is_near(world.neighbourhoods.size());
    for (const std::uint32_t p : near) is_near[p] = true;
    std::vector<std::pair<float, std::uint32_t>> expected;
    for (std::uint32_t u = 0; u < world.bags.size(); ++u) {
      if (u != v && is_near[world.panorama_of_view[u]])
        expected.emplace_back(-Similarity(world.bags[v], world.bags[u]), u);
    }
    std::sort(expected.begin(), expected.end());
    expected.resize(std::min(expected.size(), static_cast<std::size_t>(num_similar)));
    ASSERT_EQ(index.offsets[v + 1] - index.offsets[v], expected.size());
    for (std::size_t k = 0; k < expected.size(); ++k) {
      const std::size_t at = index.offsets[v] + k;
      ASSERT_EQ(index.views[at], expected[k].second) << "row " << v;
      ASSERT_EQ(index.similarity[at], -expected[k].first);
    }
  }
}

TEST(SimilarityRows, AgreesWithBruteForce) {
  const World world = MakeWorld();
  for (const int num_similar : {1, 7, 1000}) ExpectBruteForce(world, num_similar);
}

// A street of 2000 views, and as many that all see each other.
TEST(SimilarityRows, AgreesWithBruteForceOnAStreet) {
  ExpectBruteForce(MakeWorld(500, 3), 32);
  ExpectBruteForce(MakeWorld(500, 500), 32);
}

TEST(SimilarityRows, DoesNotDependOnThreads) {
  const World world = MakeWorld();
  SimilarityIndex one;
  {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
    one = Build(world, 12);
  }
  const SimilarityIndex many = Build(world, 12);
  EXPECT_EQ(one.offsets, many.offsets);
  EXPECT_EQ(one.views, many.views);
  EXPECT_EQ(one.similarity, many.similarity);
}

// What tiles rely on: rows by parts are the rows of the whole.
TEST(SimilarityRows, ASliceIsAPartOfTheWhole) {
  const World world = MakeWorld();
  const SimilarityIndex whole = Build(world, 7);
  constexpr std::size_t kBegin = 20, kEnd = 45;
  SimilarityOptions options;
  options.num_similar = 7;
  const SimilarityIndex slice = SimilarityRows(world.bags, world.panorama_of_view,
                                               world.neighbourhoods, options, kBegin, kEnd);
  ASSERT_EQ(slice.offsets.size(), kEnd - kBegin + 1);
  for (std::size_t r = kBegin; r < kEnd; ++r) {
    const std::size_t n = whole.offsets[r + 1] - whole.offsets[r];
    ASSERT_EQ(slice.offsets[r - kBegin + 1] - slice.offsets[r - kBegin], n);
    for (std::size_t i = 0; i < n; ++i) {
      EXPECT_EQ(slice.views[slice.offsets[r - kBegin] + i], whole.views[whole.offsets[r] + i]);
      EXPECT_EQ(slice.similarity[slice.offsets[r - kBegin] + i],
                whole.similarity[whole.offsets[r] + i]);
    }
  }
}

TEST(SimilarityRows, NoViews) {
  const SimilarityIndex index = SimilarityRows({}, {}, {}, {}, 0, 0);
  EXPECT_EQ(index.offsets, std::vector<std::uint32_t>{0});
  EXPECT_TRUE(index.views.empty());
}

}  // namespace
}  // namespace panofix
