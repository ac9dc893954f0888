#pragma once
// Visual words: two hierarchical k-means trees (SIFT, MSER) and TF-IDF bags over both.

#include <cstdint>
#include <span>
#include <vector>

#include "common/base/status.h"
#include "common/features/features.h"

namespace panofix {

// A tree of byte centroids in breadth-first order; leaves are the words (Nister and Stewenius, CVPR
// 2006). Node 0 is the root and has no centroid of use.
struct VocabularyTree {
  std::vector<std::uint8_t> centroids;     // num_nodes x 128
  std::vector<std::uint32_t> first_child;  // num_nodes; 0 = leaf
  std::vector<std::uint32_t> num_children;
  std::vector<std::uint32_t> word;  // of a leaf; 0 elsewhere
  std::uint32_t num_words = 0;

  [[nodiscard]] bool empty() const { return num_words == 0; }
  // Word of a descriptor: greedy descent, nearest child by squared L2, first of equals.
  [[nodiscard]] std::uint32_t Quantize(const std::uint8_t* descriptor) const;
  // The `count` nearest words by beam search (as many nodes are kept a level), nearest first.
  void QuantizeSoft(const std::uint8_t* descriptor, int count,
                    std::vector<std::uint32_t>* words) const;
  // kBadData where sizes, child ranges or word numbers are inconsistent.
  [[nodiscard]] Status Check() const;
};

// One entry of a sparse vector.
struct WeightedWord {
  std::uint32_t word = 0;
  float weight = 0;
};
// Sorted by word, unit length (or empty).
using BagOfWords = std::vector<WeightedWord>;

// Cosine similarity of two bags.
[[nodiscard]] float Similarity(const BagOfWords& a, const BagOfWords& b);

// Both trees and the inverse document frequencies. Word numbers: SIFT words first, MSER words
// after.
struct Vocabulary {
  VocabularyTree sift, mser;
  std::vector<float> idf;  // sift.num_words + mser.num_words

  [[nodiscard]] std::uint32_t num_words() const { return sift.num_words + mser.num_words; }
  // Words of a feature set, in its order, in the joint numbering.
  [[nodiscard]] std::vector<std::uint32_t> SiftWords(const FeatureSet& features) const;
  [[nodiscard]] std::vector<std::uint32_t> MserWords(const FeatureSet& features) const;
  // TF-IDF of each half, each normalised, then merged with equal weight (paper, section III-B).
  [[nodiscard]] BagOfWords Bag(std::span<const std::uint32_t> sift_words,
                               std::span<const std::uint32_t> mser_words) const;
  [[nodiscard]] Status Check() const;
};

// Inverse document frequency ln(N / N_i) of each word from the number of views that show it, 0 for
// words that none does.
[[nodiscard]] std::vector<float> InverseDocumentFrequency(std::span<const std::uint32_t> views_with,
                                                          std::uint64_t num_views);

// Views by word. Scores a query against all views, or against chosen ones only.
class InvertedIndex {
 public:
  InvertedIndex() = default;
  // bags[i] belongs to view i. Takes memory for the words that are there, not for all that may be.
  explicit InvertedIndex(std::span<const BagOfWords> bags);
  [[nodiscard]] std::size_t num_views() const { return num_views_; }
  // Cosine similarity to every view.
  [[nodiscard]] std::vector<float> Score(const BagOfWords& query) const;
  [[nodiscard]] std::size_t num_bytes() const;

 private:
  std::size_t num_views_ = 0;
  std::vector<std::uint32_t> words_, offsets_;  // words ascending, the rows of each
  std::vector<std::uint32_t> views_;
  std::vector<float> weights_;
};

}  // namespace panofix
