#include <gtest/gtest.h>

#include "common/vocabulary/vocabulary.h"
#include "tests/common/vocabulary/make_tree.h"

namespace panofix {
namespace {

std::vector<BagOfWords> RandomBags(const Vocabulary& vocabulary, std::size_t count, Rng* rng) {
  std::vector<BagOfWords> bags;
  for (std::size_t i = 0; i < count; ++i) {
    std::vector<std::uint32_t> sift, mser;
    for (int k = 0; k < 15; ++k) sift.push_back(static_cast<std::uint32_t>(rng->Below(36)));
    for (int k = 0; k < 4; ++k) mser.push_back(36 + static_cast<std::uint32_t>(rng->Below(16)));
    bags.push_back(vocabulary.Bag(sift, mser));
  }
  return bags;
}

TEST(InvertedIndex, ScoresAreThePairwiseSimilarities) {
  Rng rng(1, "tests/index");
  const Vocabulary vocabulary = RandomVocabulary(&rng);
  std::vector<BagOfWords> bags = RandomBags(vocabulary, 60, &rng);
  bags[17] = {};
  const InvertedIndex index(bags);
  EXPECT_EQ(index.num_views(), 60U);
  for (const BagOfWords& query : RandomBags(vocabulary, 10, &rng)) {
    const std::vector<float> scores = index.Score(query);
    ASSERT_EQ(scores.size(), bags.size());
    // The same products in the same order: equal to the last bit.
    for (std::size_t i = 0; i < bags.size(); ++i) EXPECT_EQ(scores[i], Similarity(query, bags[i]));
  }
}

TEST(InvertedIndex, EmptyAndForeignQueries) {
  Rng rng(1, "tests/foreign");
  const Vocabulary vocabulary = RandomVocabulary(&rng);
  const InvertedIndex index(RandomBags(vocabulary, 3, &rng));
  EXPECT_EQ(index.Score({}), std::vector<float>(3, 0.0F));
  EXPECT_EQ(index.Score({{52, 1.0F}, {~0U, 1.0F}}), std::vector<float>(3, 0.0F));
  EXPECT_TRUE(InvertedIndex().Score({{0, 1.0F}}).empty());
  EXPECT_EQ(InvertedIndex(std::span<const BagOfWords>{}).num_views(), 0U);
}

}  // namespace
}  // namespace panofix
