#include "builder/similarity/similarity_index.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>

#include "tests/common/vocabulary/make_tree.h"

namespace panofix {
namespace {

constexpr std::uint32_t kPanoramas = 25, kViewsPerPanorama = 4;

struct World {
  std::vector<BagOfWords> bags;
  std::vector<std::uint32_t> panorama_of_view;
  std::vector<std::vector<std::uint32_t>> neighbourhoods;
};

// Random bags; panoramas in a row see those up to three away.
World MakeWorld() {
  Rng rng(1, "tests/similarity");
  const Vocabulary vocabulary = RandomVocabulary(&rng);
  World world;
  for (std::uint32_t p = 0; p < kPanoramas; ++p) {
    for (std::uint32_t v = 0; v < kViewsPerPanorama; ++v) {
      std::vector<std::uint32_t> words;
      for (int i = 0; i < 8; ++i) words.push_back(static_cast<std::uint32_t>(rng.Below(36)));
      world.bags.push_back(vocabulary.Bag(words, {}));
      world.panorama_of_view.push_back(p);
    }
    auto& near = world.neighbourhoods.emplace_back();
    for (std::uint32_t q = 0; q < kPanoramas; ++q) {
      if (std::max(p, q) - std::min(p, q) <= 3) near.push_back(q);
    }
  }
  world.bags[30] = world.bags[31];  // equals
  world.bags[40] = {};
  return world;
}

SimilarityIndex Build(const World& world, int num_similar) {
  SimilarityOptions options;
  options.num_similar = num_similar;
  return BuildSimilarityIndex(world.bags, world.panorama_of_view, world.neighbourhoods, options);
}

TEST(BuildSimilarityIndex, AgreesWithBruteForce) {
  const World world = MakeWorld();
  for (const int num_similar : {1, 7, 1000}) {
    const SimilarityIndex index = Build(world, num_similar);
    ASSERT_EQ(index.offsets.size(), world.bags.size() + 1);
    ASSERT_EQ(index.views.size(), index.offsets.back());
    ASSERT_EQ(index.similarity.size(), index.views.size());
    for (std::uint32_t v = 0; v < world.bags.size(); ++v) {
      std::vector<std::uint32_t> expected;
      for (std::uint32_t u = 0; u < world.bags.size(); ++u) {
        const auto& near = world.neighbourhoods[world.panorama_of_view[v]];
        if (u != v && std::count(near.begin(), near.end(), world.panorama_of_view[u]) > 0)
          expected.push_back(u);
      }
      std::stable_sort(expected.begin(), expected.end(), [&](std::uint32_t a, std::uint32_t b) {
        return Similarity(world.bags[v], world.bags[a]) > Similarity(world.bags[v], world.bags[b]);
      });
      expected.resize(std::min(expected.size(), static_cast<std::size_t>(num_similar)));
      ASSERT_EQ(index.offsets[v + 1] - index.offsets[v], expected.size());
      for (std::size_t k = 0; k < expected.size(); ++k) {
        const std::size_t at = index.offsets[v] + k;
        ASSERT_EQ(index.views[at], expected[k]) << "row " << v;
        ASSERT_EQ(index.similarity[at], Similarity(world.bags[v], world.bags[expected[k]]));
      }
    }
  }
}

TEST(BuildSimilarityIndex, DoesNotDependOnThreads) {
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

TEST(BuildSimilarityIndex, NoViews) {
  const SimilarityIndex index = BuildSimilarityIndex({}, {}, {}, {});
  EXPECT_EQ(index.offsets, std::vector<std::uint32_t>{0});
  EXPECT_TRUE(index.views.empty());
}

}  // namespace
}  // namespace panofix
