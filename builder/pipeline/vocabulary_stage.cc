#include "builder/pipeline/vocabulary_stage.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "builder/train/tree_trainer.h"
#include "common/base/log.h"
#include "common/base/rng.h"
#include "common/map/landmark_codes.h"

namespace panofix {
namespace {

// Descriptors a word that k-means is trained on; more changes little and costs linearly.
constexpr std::size_t kSamplesPerWord = 40;

// Words must not depend on whether the tree was written and read.
void RoundToPacked(VocabularyTree* tree) {
  std::uint8_t packed[kPackedDescriptorSize];
  for (std::size_t i = 0; i < tree->centroids.size(); i += kDescriptorSize) {
    std::uint8_t* centroid = &tree->centroids[i];
    PackDescriptor(std::span<const std::uint8_t, kDescriptorSize>(centroid, kDescriptorSize),
                   packed);
    UnpackDescriptor(packed, centroid);
  }
}

// Of unit length again; equal weights by word.
BagOfWords KeepHeaviest(BagOfWords bag, int max_words) {
  const auto keep = static_cast<std::size_t>(max_words);
  if (max_words == 0 || bag.size() <= keep) return bag;
  std::sort(bag.begin(), bag.end(), [](const WeightedWord& a, const WeightedWord& b) {
    return a.weight > b.weight || (a.weight == b.weight && a.word < b.word);
  });
  bag.resize(keep);
  std::sort(bag.begin(), bag.end(),
            [](const WeightedWord& a, const WeightedWord& b) { return a.word < b.word; });
  double sum_sq = 0;
  for (const WeightedWord& w : bag) sum_sq += double{w.weight} * double{w.weight};
  for (WeightedWord& w : bag) w.weight /= static_cast<float>(std::sqrt(sum_sq));
  return bag;
}

}  // namespace

std::vector<TrainingSample> SampleDescriptors(const std::vector<ExtractedPanorama>& panoramas,
                                              std::size_t num_in_build,
                                              const VocabularyStageOptions& options) {
  const auto budget = [&](int words) {
    return std::max<std::size_t>(1, static_cast<std::size_t>(words) * kSamplesPerWord /
                                        std::max<std::size_t>(1, num_in_build));
  };
  std::vector<TrainingSample> parts(panoramas.size());
  tbb::parallel_for(std::size_t{0}, panoramas.size(), [&](std::size_t p) {
    const PanoramaFeatures features =
        ValueOrThrow(ReadPanoramaFeatures(panoramas[p].features_file));
    Rng rng(options.seed, "sample/" + panoramas[p].record.id);
    const auto draw = [&](bool mser, std::size_t count, std::vector<std::uint8_t>* out) {
      std::vector<std::pair<const FeatureSet*, std::size_t>> all;
      for (const ViewFeatureSet& view : features.views) {
        const FeatureSet& set = mser ? view.mser : view.sift;
        for (std::size_t i = 0; i < set.size(); ++i) all.emplace_back(&set, i);
      }
      for (std::size_t i = 0; i < std::min(count, all.size()); ++i) {
        std::swap(all[i], all[i + rng.Below(all.size() - i)]);
        const auto descriptor = all[i].first->descriptor(all[i].second);
        out->insert(out->end(), descriptor.begin(), descriptor.end());
      }
    };
    draw(false, budget(options.num_sift_words), &parts[p].sift);
    draw(true, budget(options.num_mser_words), &parts[p].mser);
  });
  return parts;
}

Vocabulary TrainVocabulary(const TrainingSample& sample, const VocabularyStageOptions& options) {
  TreeOptions tree;
  tree.seed = options.seed;
  Vocabulary vocabulary;
  tree.num_words = options.num_sift_words;
  vocabulary.sift = TrainTree(sample.sift, tree, "train/sift");
  tree.num_words = options.num_mser_words;
  vocabulary.mser = TrainTree(sample.mser, tree, "train/mser");
  const auto warn_of_few = [](const char* kind, std::uint32_t num_words, int asked) {
    constexpr double kFew = 0.8;
    if (num_words < kFew * asked) {
      LogWarning(Format("%u %s words instead of %d: the data set has too few different features",
                        num_words, kind, asked));
    }
  };
  warn_of_few("SIFT", vocabulary.sift.num_words, options.num_sift_words);
  warn_of_few("MSER", vocabulary.mser.num_words, options.num_mser_words);
  if (options.pack) {
    RoundToPacked(&vocabulary.sift);
    RoundToPacked(&vocabulary.mser);
  }
  if (vocabulary.sift.empty()) {
    throw Error(
        ErrorCode::kBadData,
        "no feature in any panorama; check the images, their masks and --sift-contrast-threshold");
  }
  vocabulary.idf.assign(vocabulary.num_words(), 0.0F);
  return vocabulary;
}

std::vector<ViewWords> QuantiseViews(std::span<const PanoramaFeatures> features,
                                     const Vocabulary& vocabulary) {
  std::vector<ViewWords> words;
  for (const PanoramaFeatures& some : features) {
    for (const ViewFeatureSet& view : some.views)
      words.push_back({vocabulary.SiftWords(view.sift), vocabulary.MserWords(view.mser)});
  }
  return words;
}

void CountWords(std::span<const ViewWords> views, std::vector<std::uint32_t>* counts) {
  for (const ViewWords& view : views) {
    std::vector<std::uint32_t> all = view.sift;
    all.insert(all.end(), view.mser.begin(), view.mser.end());
    std::sort(all.begin(), all.end());
    all.erase(std::unique(all.begin(), all.end()), all.end());
    for (const std::uint32_t word : all) ++counts->at(word);
  }
}

BagOfWords MakeBag(const ViewWords& words, const Vocabulary& vocabulary, int max_words) {
  return KeepHeaviest(vocabulary.Bag(words.sift, words.mser), max_words);
}

}  // namespace panofix
