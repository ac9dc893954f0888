#include "common/map/vocabulary_file.h"

#include "common/map/landmark_codes.h"
#include "common/map/map_arrays.h"

namespace panofix {

using namespace map_internal;

namespace {

Status LoadTree(const Hdf5Reader& file, const std::string& group, VocabularyTree* tree) {
  PANOFIX_READ(centroids, file, std::uint8_t, group + "/centroids", -1);
  PANOFIX_READ(first_child, file, std::uint32_t, group + "/first_child", 1);
  PANOFIX_READ(num_children, file, std::uint32_t, group + "/num_children", 1);
  PANOFIX_READ(word, file, std::uint32_t, group + "/word", 1);
  if (centroids.cols == kPackedDescriptorSize) {
    const auto nodes = static_cast<std::size_t>(centroids.rows);
    tree->centroids.resize(nodes * kDescriptorSize);
    for (std::size_t i = 0; i < nodes; ++i)
      UnpackDescriptor(&centroids.values[i * kPackedDescriptorSize],
                       &tree->centroids[i * kDescriptorSize]);
  } else if (centroids.cols == kDescriptorSize) {
    tree->centroids.assign(centroids.values.begin(), centroids.values.end());
  } else {
    return Bad(group + "/centroids: a row has " + std::to_string(centroids.cols) + " columns");
  }
  tree->first_child.assign(first_child.values.begin(), first_child.values.end());
  tree->num_children.assign(num_children.values.begin(), num_children.values.end());
  tree->word.assign(word.values.begin(), word.values.end());
  tree->num_words = 0;
  for (std::size_t node = 0; node < tree->word.size(); ++node) {
    if (tree->num_children.size() == tree->word.size() && tree->num_children[node] == 0)
      ++tree->num_words;
  }
  return {};
}

}  // namespace

Result<Vocabulary> ReadVocabulary(const Hdf5Reader& file) {
  Vocabulary vocabulary;
  Status status = LoadTree(file, "sift", &vocabulary.sift);
  if (status.ok()) status = LoadTree(file, "mser", &vocabulary.mser);
  if (!status.ok()) return status;
  PANOFIX_READ(idf, file, float, "idf", 1);
  vocabulary.idf.assign(idf.values.begin(), idf.values.end());
  status = vocabulary.Check();
  if (!status.ok()) return status;
  if (vocabulary.sift.empty()) return Bad("a vocabulary without SIFT words");
  return vocabulary;
}

}  // namespace panofix
