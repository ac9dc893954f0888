#pragma once
// Training the vocabularies, and turning views into words and bags.

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "builder/pipeline/extract_stage.h"
#include "common/vocabulary/vocabulary.h"

namespace panofix {

struct VocabularyStageOptions {
  int num_sift_words = 5000, num_mser_words = 2000;
  std::uint64_t seed = 1;
  bool pack = true;  // centroids as they come back from a bundle of packed descriptors
};

// Descriptors to train on, N x 128 each.
struct TrainingSample {
  std::vector<std::uint8_t> sift, mser;
};

// A seeded reservoir of each panorama's own views, as large for each, whatever shard it is in.
// `num_in_build`: panoramas of all shards. TBB over panoramas.
[[nodiscard]] std::vector<TrainingSample> SampleDescriptors(
    const std::vector<ExtractedPanorama>& panoramas, std::size_t num_in_build,
    const VocabularyStageOptions& options);

// Trains both trees; idf is still zero. Throws Error(kBadData) where the sample is empty. Its order
// matters: by panorama id.
[[nodiscard]] Vocabulary TrainVocabulary(const TrainingSample& sample,
                                         const VocabularyStageOptions& options);

// Words of one view, in the joint numbering.
struct ViewWords {
  std::vector<std::uint32_t> sift, mser;
};

// Words of every view of a panorama, `features` one after the other.
[[nodiscard]] std::vector<ViewWords> QuantiseViews(std::span<const PanoramaFeatures> features,
                                                   const Vocabulary& vocabulary);
// Adds the views that show each word to `counts`.
void CountWords(std::span<const ViewWords> views, std::vector<std::uint32_t>* counts);
// A view's bag of its `max_words` heaviest words (0 = all).
[[nodiscard]] BagOfWords MakeBag(const ViewWords& words, const Vocabulary& vocabulary,
                                 int max_words);

// Work files (schemas/work_files.md). Reading fails with kBadData or kNotFound.
void WriteSamples(const std::filesystem::path& path, std::span<const std::string> ids,
                  std::span<const TrainingSample> samples);
// Adds a file's samples, by panorama id.
[[nodiscard]] Status ReadSamples(const std::filesystem::path& path,
                                 std::map<std::string, TrainingSample>* samples);
void WriteWords(const std::filesystem::path& path, std::span<const ViewWords> views);
[[nodiscard]] Result<std::vector<ViewWords>> ReadWords(const std::filesystem::path& path);

}  // namespace panofix
