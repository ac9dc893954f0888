#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <map>

#include "common/vocabulary/vocabulary.h"
#include "tests/common/vocabulary/make_tree.h"

namespace panofix {
namespace {

constexpr double kFloat = 1e-6;  // sums of some dozens of floats near 1

using Words = std::vector<std::uint32_t>;

double Norm(const BagOfWords& bag) {
  double sum_sq = 0;
  for (const WeightedWord& entry : bag) sum_sq += double{entry.weight} * double{entry.weight};
  return std::sqrt(sum_sq);
}

Words RandomWords(std::size_t count, std::uint32_t first, std::uint32_t bound, Rng* rng) {
  Words words;
  for (std::size_t i = 0; i < count; ++i) {
    words.push_back(first + static_cast<std::uint32_t>(rng->Below(bound)));
  }
  return words;
}

// TF-IDF of one half by its definition.
std::map<std::uint32_t, double> TfIdf(const Words& words, const std::vector<float>& idf,
                                      double norm) {
  std::map<std::uint32_t, double> weights;
  for (const std::uint32_t word : words) weights[word] += double{idf[word]};
  double sum_sq = 0;
  for (const auto& [word, weight] : weights) sum_sq += weight * weight;
  for (auto& [word, weight] : weights) weight *= norm / std::sqrt(sum_sq);
  return weights;
}

TEST(Bag, IsEachHalfsTfIdfNormalisedAndMerged) {
  Rng rng(1, "tests/bag");
  const Vocabulary vocabulary = RandomVocabulary(&rng);
  for (int i = 0; i < 20; ++i) {
    const Words sift = RandomWords(50, 0, 36, &rng), mser = RandomWords(9, 36, 16, &rng);
    auto expected = TfIdf(sift, vocabulary.idf, std::sqrt(0.5));
    expected.merge(TfIdf(mser, vocabulary.idf, std::sqrt(0.5)));
    const BagOfWords bag = vocabulary.Bag(sift, mser);
    ASSERT_EQ(bag.size(), expected.size());
    std::size_t k = 0;
    for (const auto& [word, weight] : expected) {
      EXPECT_EQ(bag[k].word, word);  // both ascend
      EXPECT_NEAR(double{bag[k++].weight}, weight, kFloat);
    }
    EXPECT_NEAR(Norm(bag), 1, kFloat);
    EXPECT_NEAR(double{Similarity(bag, bag)}, 1, kFloat);
  }
}

TEST(Bag, OneHalfAloneHasUnitLengthToo) {
  Rng rng(1, "tests/half");
  const Vocabulary vocabulary = RandomVocabulary(&rng);
  EXPECT_NEAR(Norm(vocabulary.Bag(RandomWords(10, 0, 36, &rng), {})), 1, kFloat);
  EXPECT_NEAR(Norm(vocabulary.Bag({}, RandomWords(10, 36, 16, &rng))), 1, kFloat);
  EXPECT_TRUE(vocabulary.Bag({}, {}).empty());
}

// A half whose words are all in every view weighs nothing; the other half then stands alone.
TEST(Bag, AHalfWithoutWeightCountsAsAbsent) {
  Rng rng(1, "tests/weightless");
  Vocabulary vocabulary = RandomVocabulary(&rng);
  for (std::size_t word = 36; word < vocabulary.idf.size(); ++word) vocabulary.idf[word] = 0;
  EXPECT_NEAR(Norm(vocabulary.Bag(RandomWords(10, 0, 36, &rng), RandomWords(5, 36, 16, &rng))), 1,
              kFloat);
  std::fill(vocabulary.idf.begin(), vocabulary.idf.end(), 0.0F);
  EXPECT_TRUE(vocabulary.Bag(RandomWords(10, 0, 36, &rng), {}).empty());
}

TEST(Bag, UnknownWordsWeighNothing) {
  Rng rng(1, "tests/unknown");
  const Vocabulary vocabulary = RandomVocabulary(&rng);
  EXPECT_TRUE(vocabulary.Bag(Words{5000, ~0U}, {}).empty());
}

TEST(Similarity, IsTheCosine) {
  const BagOfWords a{{1, 0.6F}, {4, 0.8F}}, b{{0, 0.8F}, {4, 0.6F}}, c{{2, 1.0F}};
  EXPECT_NEAR(double{Similarity(a, b)}, 0.48, kFloat);
  EXPECT_EQ(Similarity(a, b), Similarity(b, a));
  EXPECT_EQ(Similarity(a, c), 0.0F);
  EXPECT_EQ(Similarity(a, {}), 0.0F);
}

TEST(Vocabulary, MserWordsFollowTheSiftWords) {
  Rng rng(1, "tests/words");
  const Vocabulary vocabulary = RandomVocabulary(&rng);
  FeatureSet features;
  features.descriptors = RandomDescriptors(30, &rng);
  features.keypoints.resize(30);
  const Words sift = vocabulary.SiftWords(features), mser = vocabulary.MserWords(features);
  ASSERT_EQ(sift.size(), 30U);
  ASSERT_EQ(mser.size(), 30U);
  for (std::size_t i = 0; i < 30; ++i) {
    EXPECT_EQ(sift[i], vocabulary.sift.Quantize(features.descriptor(i).data()));
    EXPECT_EQ(mser[i], 36 + vocabulary.mser.Quantize(features.descriptor(i).data()));
  }
  EXPECT_TRUE(Vocabulary().SiftWords(features).empty());
  EXPECT_TRUE(Vocabulary().MserWords(features).empty());
}

TEST(Vocabulary, CheckLooksAtTreesAndIdf) {
  Rng rng(1, "tests/check");
  const Vocabulary good = RandomVocabulary(&rng);
  EXPECT_TRUE(good.Check().ok());
  EXPECT_TRUE(Vocabulary().Check().ok());
  Vocabulary bad = good;
  bad.idf.pop_back();
  EXPECT_EQ(bad.Check().code(), ErrorCode::kBadData);
  for (const float value : {-1.0F, 1e9F, std::numeric_limits<float>::quiet_NaN()}) {
    bad = good;
    bad.idf[3] = value;
    EXPECT_EQ(bad.Check().code(), ErrorCode::kBadData) << value;
  }
  bad = good;
  bad.mser.first_child[0] = ~0U;
  EXPECT_EQ(bad.Check().code(), ErrorCode::kBadData);
}

TEST(InverseDocumentFrequency, IsTheLogarithmOfTheShare) {
  const std::vector<std::uint32_t> views_with{1, 4, 2, 0};
  const std::vector<float> idf = InverseDocumentFrequency(views_with, 4);
  ASSERT_EQ(idf.size(), 4U);
  EXPECT_NEAR(double{idf[0]}, std::log(4.0), kFloat);
  EXPECT_EQ(idf[1], 0.0F);  // in every view
  EXPECT_NEAR(double{idf[2]}, std::log(2.0), kFloat);
  EXPECT_EQ(idf[3], 0.0F);  // in none
  EXPECT_TRUE(InverseDocumentFrequency({}, 2).empty());
}

}  // namespace
}  // namespace panofix
