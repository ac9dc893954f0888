#include "builder/pipeline/vocabulary_stage.h"

#include <tbb/parallel_for.h>

#include <algorithm>

#include "builder/train/tree_trainer.h"
#include "common/base/progress.h"
#include "common/base/rng.h"

namespace panofix {
namespace {

// Descriptors a word that k-means is trained on; more changes little and costs linearly.
constexpr std::size_t kSamplesPerWord = 40;

// Gathers a seeded sample of at most `budget` descriptors, the same share of every panorama.
struct TrainingSample {
  std::vector<std::uint8_t> sift, mser;
};
TrainingSample Sample(const std::vector<ExtractedPanorama>& panoramas,
                      const VocabularyStageOptions& options) {
  const std::size_t n = panoramas.size();
  const auto budget = [&](int words) {
    return std::max<std::size_t>(1, static_cast<std::size_t>(words) * kSamplesPerWord / n);
  };
  std::vector<TrainingSample> parts(n);
  tbb::parallel_for(std::size_t{0}, n, [&](std::size_t p) {
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
  TrainingSample sample;
  for (const TrainingSample& part : parts) {
    sample.sift.insert(sample.sift.end(), part.sift.begin(), part.sift.end());
    sample.mser.insert(sample.mser.end(), part.mser.begin(), part.mser.end());
  }
  return sample;
}

}  // namespace

Vocabulary TrainVocabulary(const std::vector<ExtractedPanorama>& panoramas,
                           const VocabularyStageOptions& options) {
  const TrainingSample sample = Sample(panoramas, options);
  TreeOptions tree;
  tree.seed = options.seed;
  Vocabulary vocabulary;
  tree.num_words = options.num_sift_words;
  vocabulary.sift = TrainTree(sample.sift, tree, "train/sift");
  tree.num_words = options.num_mser_words;
  vocabulary.mser = TrainTree(sample.mser, tree, "train/mser");
  if (vocabulary.sift.empty()) {
    throw Error(
        ErrorCode::kBadData,
        "no feature in any panorama; check the images, their masks and --sift-contrast-threshold");
  }
  return vocabulary;
}

std::vector<BagOfWords> MakeBags(const std::vector<ExtractedPanorama>& panoramas,
                                 std::size_t views_each, Vocabulary* vocabulary) {
  std::vector<std::vector<std::uint32_t>> sift(panoramas.size() * views_each), mser(sift.size());
  Progress progress("words", static_cast<std::int64_t>(panoramas.size()), "panoramas");
  tbb::parallel_for(std::size_t{0}, panoramas.size(), [&](std::size_t p) {
    const PanoramaFeatures features =
        ValueOrThrow(ReadPanoramaFeatures(panoramas[p].features_file));
    for (std::size_t v = 0; v < views_each; ++v) {
      sift[p * views_each + v] = vocabulary->SiftWords(features.views[v].sift);
      mser[p * views_each + v] = vocabulary->MserWords(features.views[v].mser);
    }
    progress.Add();
  });
  progress.Finish();
  std::vector<std::vector<std::uint32_t>> all = sift;
  for (std::size_t i = 0; i < all.size(); ++i)
    all[i].insert(all[i].end(), mser[i].begin(), mser[i].end());
  vocabulary->idf = InverseDocumentFrequency(all, vocabulary->num_words());
  std::vector<BagOfWords> bags(sift.size());
  tbb::parallel_for(std::size_t{0}, bags.size(),
                    [&](std::size_t i) { bags[i] = vocabulary->Bag(sift[i], mser[i]); });
  return bags;
}

}  // namespace panofix
