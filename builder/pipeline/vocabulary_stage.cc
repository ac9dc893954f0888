#include "builder/pipeline/vocabulary_stage.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "builder/train/tree_trainer.h"
#include "common/base/progress.h"
#include "common/base/rng.h"
#include "common/map/landmark_codes.h"

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
  if (options.pack) {
    RoundToPacked(&vocabulary.sift);
    RoundToPacked(&vocabulary.mser);
  }
  if (vocabulary.sift.empty()) {
    throw Error(
        ErrorCode::kBadData,
        "no feature in any panorama; check the images, their masks and --sift-contrast-threshold");
  }
  return vocabulary;
}

std::vector<BagOfWords> MakeBags(
    std::size_t num_panoramas,
    const std::function<std::vector<PanoramaFeatures>(std::size_t)>& features_of, int max_words,
    Vocabulary* vocabulary) {
  struct ViewWords {
    std::vector<std::uint32_t> sift, mser;
  };
  std::vector<std::vector<ViewWords>> by_panorama(num_panoramas);
  Progress progress("words", static_cast<std::int64_t>(num_panoramas), "panoramas");
  tbb::parallel_for(std::size_t{0}, num_panoramas, [&](std::size_t p) {
    for (const PanoramaFeatures& features : features_of(p)) {
      for (const ViewFeatureSet& view : features.views) {
        by_panorama[p].push_back(
            {vocabulary->SiftWords(view.sift), vocabulary->MserWords(view.mser)});
      }
    }
    progress.Add();
  });
  progress.Finish();
  std::vector<ViewWords> words;
  std::vector<std::vector<std::uint32_t>> all;
  for (std::vector<ViewWords>& views : by_panorama) {
    for (ViewWords& view : views) {
      all.push_back(view.sift);
      all.back().insert(all.back().end(), view.mser.begin(), view.mser.end());
      words.push_back(std::move(view));
    }
  }
  vocabulary->idf = InverseDocumentFrequency(all, vocabulary->num_words());
  std::vector<BagOfWords> bags(words.size());
  tbb::parallel_for(std::size_t{0}, bags.size(), [&](std::size_t i) {
    bags[i] = KeepHeaviest(vocabulary->Bag(words[i].sift, words[i].mser), max_words);
  });
  return bags;
}

}  // namespace panofix
