#include <gtest/gtest.h>

#include <functional>

#include "common/features/matcher.h"
#include "common/vocabulary/vocabulary.h"
#include "tests/common/vocabulary/make_tree.h"

namespace panofix {
namespace {

TEST(VocabularyTree, OneLevelIsNearestNeighbour) {
  Rng rng(1, "tests/one_level");
  const VocabularyTree tree = RandomTree(12, 1, &rng);
  ASSERT_TRUE(tree.Check().ok());
  for (int i = 0; i < 200; ++i) {
    const auto descriptor = RandomDescriptors(1, &rng);
    std::uint32_t nearest = 1;
    for (std::uint32_t node = 2; node <= 12; ++node) {
      const auto distance = [&](std::uint32_t n) {
        return DescriptorDistanceSq(descriptor.data(), &tree.centroids[n * std::size_t{128}]);
      };
      if (distance(node) < distance(nearest)) nearest = node;
    }
    EXPECT_EQ(tree.Quantize(descriptor.data()), tree.word[nearest]);
  }
}

TEST(VocabularyTree, DescendsGreedily) {
  Rng rng(1, "tests/greedy");
  const VocabularyTree tree = RandomTree(5, 3, &rng);
  ASSERT_TRUE(tree.Check().ok());
  EXPECT_EQ(tree.num_words, 125U);
  for (int i = 0; i < 200; ++i) {
    const auto descriptor = RandomDescriptors(1, &rng);
    std::uint32_t node = 0;
    for (int level = 0; level < 3; ++level) {
      std::uint32_t best = tree.first_child[node];
      for (std::uint32_t c = best; c < tree.first_child[node] + 5; ++c) {
        if (DescriptorDistanceSq(descriptor.data(), &tree.centroids[c * std::size_t{128}]) <
            DescriptorDistanceSq(descriptor.data(), &tree.centroids[best * std::size_t{128}])) {
          best = c;
        }
      }
      node = best;
    }
    EXPECT_EQ(tree.Quantize(descriptor.data()), tree.word[node]);
  }
}

TEST(VocabularyTree, EqualsGoToTheFirstChild) {
  Rng rng(1, "tests/equals");
  VocabularyTree tree = RandomTree(4, 1, &rng);
  for (std::size_t node = 1; node <= 4; ++node) {
    std::fill_n(&tree.centroids[node * 128], 128, std::uint8_t{9});
  }
  EXPECT_EQ(tree.Quantize(RandomDescriptors(1, &rng).data()), tree.word[1]);
}

TEST(VocabularyTree, ALoneRootIsOneWord) {
  VocabularyTree tree;
  tree.centroids.resize(128), tree.first_child = {0}, tree.num_children = {0}, tree.word = {0};
  tree.num_words = 1;
  EXPECT_TRUE(tree.Check().ok());
  EXPECT_EQ(tree.Quantize(tree.centroids.data()), 0U);
  EXPECT_TRUE(VocabularyTree().Check().ok());
  EXPECT_TRUE(VocabularyTree().empty());
}

TEST(VocabularyTree, CheckRefusesCorruptedTrees) {
  Rng rng(1, "tests/corrupt");
  const VocabularyTree good = RandomTree(3, 2, &rng);
  ASSERT_TRUE(good.Check().ok());
  using Change = std::function<void(VocabularyTree*)>;
  const std::vector<std::pair<const char*, Change>> changes{
      {"centroid cut", [](VocabularyTree* t) { t->centroids.pop_back(); }},
      {"children cut", [](VocabularyTree* t) { t->num_children.pop_back(); }},
      {"word cut", [](VocabularyTree* t) { t->word.pop_back(); }},
      {"node added", [](VocabularyTree* t) { t->first_child.push_back(0); }},
      {"its own child", [](VocabularyTree* t) { t->first_child[1] = 1; }},
      {"child before parent", [](VocabularyTree* t) { t->first_child[2] = 0; }},
      {"child outside", [](VocabularyTree* t) { t->first_child[3] = 12; }},
      {"far outside", [](VocabularyTree* t) { t->first_child[3] = ~0U; }},
      {"too many children", [](VocabularyTree* t) { t->num_children[0] = ~0U; }},
      {"sum wraps", [](VocabularyTree* t) { t->first_child[3] = ~0U, t->num_children[3] = 2; }},
      {"word outside", [](VocabularyTree* t) { t->word[12] = 9; }},
      {"word twice", [](VocabularyTree* t) { t->word[12] = t->word[11]; }},
      {"words without nodes", [](VocabularyTree* t) { *t = {}, t->num_words = 3; }},
      {"more words than leaves", [](VocabularyTree* t) { t->num_words = 10; }},
  };
  for (const auto& [name, change] : changes) {
    VocabularyTree tree = good;
    change(&tree);
    EXPECT_EQ(tree.Check().code(), ErrorCode::kBadData) << name;
  }
}

}  // namespace
}  // namespace panofix
