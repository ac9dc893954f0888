#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "builder/pipeline/vocabulary_stage.h"
#include "tests/common/io/temp_folder.h"
#include "tests/common/vocabulary/make_tree.h"

namespace panofix {
namespace {

constexpr double kFloat = 1e-6;  // of weights, which are floats of at most one
constexpr std::size_t kPanoramas = 3;

FeatureSet RandomSet(std::size_t count, Rng* rng) {
  FeatureSet set;
  set.keypoints.resize(count);
  set.descriptors = RandomDescriptors(count, rng);
  return set;
}

// Panorama p has two views of its own and p at its virtual stations, of some 30 features.
std::vector<PanoramaFeatures> FeaturesOf(std::size_t p) {
  Rng rng(p, "tests/bags");
  std::vector<PanoramaFeatures> features(2);
  for (std::size_t v = 0; v < 2 + p; ++v) {
    ViewFeatureSet view;
    view.sift = RandomSet(20 + rng.Below(20), &rng);
    view.mser = RandomSet(rng.Below(8), &rng);
    features[v < 2 ? 0 : 1].views.push_back(view);
  }
  return features;
}

// As the stages do it: words, their counts, weights, bags.
template <typename Features>
std::vector<BagOfWords> MakeBags(std::size_t num_panoramas, const Features& features_of,
                                 int max_words, Vocabulary* vocabulary) {
  std::vector<ViewWords> views;
  for (std::size_t p = 0; p < num_panoramas; ++p) {
    for (ViewWords& view : QuantiseViews(features_of(p), *vocabulary)) views.push_back(view);
  }
  std::vector<std::uint32_t> counts(vocabulary->num_words(), 0);
  CountWords(views, &counts);
  vocabulary->idf = InverseDocumentFrequency(counts, views.size());
  std::vector<BagOfWords> bags;
  for (const ViewWords& view : views) bags.push_back(MakeBag(view, *vocabulary, max_words));
  return bags;
}

std::vector<BagOfWords> Bags(int max_words, Vocabulary* vocabulary) {
  Rng rng(1, "tests/vocabulary");
  *vocabulary = RandomVocabulary(&rng);
  return MakeBags(kPanoramas, FeaturesOf, max_words, vocabulary);
}

TEST(MakeBags, OneAViewStationByStation) {
  Vocabulary vocabulary;
  const std::vector<BagOfWords> bags = Bags(0, &vocabulary);
  std::vector<BagOfWords> expected;
  for (std::size_t p = 0; p < kPanoramas; ++p) {
    for (const PanoramaFeatures& features : FeaturesOf(p)) {
      for (const ViewFeatureSet& view : features.views) {
        expected.push_back(
            vocabulary.Bag(vocabulary.SiftWords(view.sift), vocabulary.MserWords(view.mser)));
      }
    }
  }
  ASSERT_EQ(bags.size(), 2U + 3U + 4U);
  ASSERT_EQ(expected.size(), bags.size());
  for (std::size_t i = 0; i < bags.size(); ++i) {
    ASSERT_EQ(bags[i].size(), expected[i].size());
    for (std::size_t k = 0; k < bags[i].size(); ++k) {
      EXPECT_EQ(bags[i][k].word, expected[i][k].word);
      EXPECT_EQ(bags[i][k].weight, expected[i][k].weight);
    }
  }
}

TEST(MakeBags, TheHeaviestWordsStayAndHaveUnitLengthAgain) {
  Vocabulary whole_vocabulary, vocabulary;
  const std::vector<BagOfWords> whole = Bags(0, &whole_vocabulary);
  for (const std::size_t most : {1U, 5U, 12U}) {
    const std::vector<BagOfWords> bags = Bags(static_cast<int>(most), &vocabulary);
    EXPECT_EQ(vocabulary.idf, whole_vocabulary.idf);  // of all words
    ASSERT_EQ(bags.size(), whole.size());
    for (std::size_t i = 0; i < bags.size(); ++i) {
      ASSERT_EQ(bags[i].size(), std::min(most, whole[i].size()));
      std::vector<WeightedWord> heaviest = whole[i];
      std::stable_sort(heaviest.begin(), heaviest.end(),
                       [](const auto& a, const auto& b) { return a.weight > b.weight; });
      heaviest.resize(bags[i].size());
      double kept_sq = 0, length_sq = 0;
      for (const WeightedWord& w : heaviest) kept_sq += std::pow(double{w.weight}, 2);
      for (const WeightedWord& w : heaviest) {
        const auto found = std::find_if(bags[i].begin(), bags[i].end(),
                                        [&](const auto& kept) { return kept.word == w.word; });
        ASSERT_NE(found, bags[i].end()) << w.word;
        EXPECT_NEAR(double{found->weight}, double{w.weight} / std::sqrt(kept_sq), kFloat);
        length_sq += std::pow(double{found->weight}, 2);
      }
      EXPECT_NEAR(length_sq, 1, 2 * kFloat * static_cast<double>(most));
      EXPECT_TRUE(std::is_sorted(bags[i].begin(), bags[i].end(),
                                 [](const auto& a, const auto& b) { return a.word < b.word; }));
    }
  }
}

TEST(MakeBags, ShortBagsAreLeftAsTheyAre) {
  Vocabulary whole_vocabulary, vocabulary;
  const std::vector<BagOfWords> whole = Bags(0, &whole_vocabulary), bags = Bags(1000, &vocabulary);
  for (std::size_t i = 0; i < bags.size(); ++i) {
    ASSERT_EQ(bags[i].size(), whole[i].size());
    for (std::size_t k = 0; k < bags[i].size(); ++k)
      EXPECT_EQ(bags[i][k].weight, whole[i][k].weight);
  }
}

TEST(MakeBags, ViewsWithoutFeaturesHaveEmptyBags) {
  Rng rng(1, "tests/vocabulary");
  Vocabulary vocabulary = RandomVocabulary(&rng);
  const auto bags = MakeBags(
      2,
      [](std::size_t p) {
        std::vector<PanoramaFeatures> features(2);
        features[0].views.resize(2);
        if (p == 1) features[0].views[0] = FeaturesOf(0)[0].views[0];
        return features;
      },
      5, &vocabulary);
  ASSERT_EQ(bags.size(), 4U);
  EXPECT_TRUE(bags[0].empty() && bags[1].empty() && bags[3].empty());
  EXPECT_EQ(bags[2].size(), 5U);
}

TEST(CountWords, CountsViewsNotOccurrences) {
  std::vector<std::uint32_t> counts(5, 0);
  CountWords(std::vector<ViewWords>{{{0, 0, 1}, {4}}, {{0}, {}}, {{}, {}}}, &counts);
  EXPECT_EQ(counts, (std::vector<std::uint32_t>{2, 1, 0, 0, 1}));
}

TEST(WordsFile, IsReadAsItWasWritten) {
  const TempFolder folder;
  const std::vector<ViewWords> views = {{{3, 1, 3}, {}}, {{}, {9}}, {{}, {}}};
  WriteWords(folder / "w.h5", views);
  const auto read = ReadWords(folder / "w.h5");
  ASSERT_TRUE(read.ok()) << read.status().message();
  ASSERT_EQ(read->size(), views.size());
  for (std::size_t v = 0; v < views.size(); ++v) {
    EXPECT_EQ((*read)[v].sift, views[v].sift);
    EXPECT_EQ((*read)[v].mser, views[v].mser);
  }
  EXPECT_FALSE(ReadWords(folder / "none.h5").ok());
}

TEST(SampleDescriptors, DoesNotDependOnTheShard) {
  const TempFolder folder;
  std::vector<ExtractedPanorama> panoramas(kPanoramas);
  for (std::size_t p = 0; p < kPanoramas; ++p) {
    PanoramaFeatures features = FeaturesOf(p)[0];
    for (ViewFeatureSet& view : features.views) view.points.resize(view.sift.size());
    features.sources = {"p"};
    panoramas[p].record.id = std::to_string(p);
    panoramas[p].features_file = folder / (std::to_string(p) + ".h5");
    WritePanoramaFeatures(panoramas[p].features_file, features);
  }
  VocabularyStageOptions options;
  options.num_sift_words = 1, options.num_mser_words = 1;  // some 13 descriptors a panorama
  const auto whole = SampleDescriptors(panoramas, kPanoramas, options);
  for (std::size_t p = 0; p < kPanoramas; ++p) {
    const auto alone = SampleDescriptors({panoramas[p]}, kPanoramas, options);
    EXPECT_EQ(alone[0].sift, whole[p].sift);
    EXPECT_EQ(alone[0].mser, whole[p].mser);
    EXPECT_EQ(whole[p].sift.size(), 13 * kDescriptorSize);
  }
  const std::vector<std::string> ids = {"0", "1", "2"};
  WriteSamples(folder / "s.h5", ids, whole);
  std::map<std::string, TrainingSample> read;
  ASSERT_TRUE(ReadSamples(folder / "s.h5", &read).ok());
  ASSERT_EQ(read.size(), kPanoramas);
  for (std::size_t p = 0; p < kPanoramas; ++p) {
    EXPECT_EQ(read[ids[p]].sift, whole[p].sift);
    EXPECT_EQ(read[ids[p]].mser, whole[p].mser);
  }
}

}  // namespace
}  // namespace panofix
