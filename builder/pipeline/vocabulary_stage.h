#pragma once
// The stage that trains the vocabularies and turns every view into a bag of words.

#include <vector>

#include "builder/pipeline/extract_stage.h"
#include "common/vocabulary/vocabulary.h"

namespace panofix {

struct VocabularyStageOptions {
  int num_sift_words = 5000, num_mser_words = 2000;
  std::uint64_t seed = 1;
};

// Trains both trees on a seeded sample, the same share of every panorama; idf is still empty.
// Throws Error(kBadData) where no panorama has a feature.
[[nodiscard]] Vocabulary TrainVocabulary(const std::vector<ExtractedPanorama>& panoramas,
                                         const VocabularyStageOptions& options);

// Quantises every view, sets the vocabulary's idf and returns a bag a view.
[[nodiscard]] std::vector<BagOfWords> MakeBags(const std::vector<ExtractedPanorama>& panoramas,
                                               std::size_t views_each, Vocabulary* vocabulary);

}  // namespace panofix
