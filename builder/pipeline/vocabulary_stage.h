#pragma once
// The stage that trains the vocabularies and turns every view into a bag of words.

#include <functional>
#include <vector>

#include "builder/pipeline/extract_stage.h"
#include "common/vocabulary/vocabulary.h"

namespace panofix {

struct VocabularyStageOptions {
  int num_sift_words = 5000, num_mser_words = 2000;
  std::uint64_t seed = 1;
  bool pack = true;  // centroids as they come back from a bundle of packed descriptors
};

// Trains both trees on a seeded sample, the same share of every panorama; idf is still empty.
// Throws Error(kBadData) where no panorama has a feature.
[[nodiscard]] Vocabulary TrainVocabulary(const std::vector<ExtractedPanorama>& panoramas,
                                         const VocabularyStageOptions& options);

// Quantises every view, sets the vocabulary's idf and returns a bag a view, of its `max_words`
// heaviest words (0 = all). `features_of` gives a panorama's views station by station.
[[nodiscard]] std::vector<BagOfWords> MakeBags(
    std::size_t num_panoramas,
    const std::function<std::vector<PanoramaFeatures>(std::size_t)>& features_of, int max_words,
    Vocabulary* vocabulary);

}  // namespace panofix
