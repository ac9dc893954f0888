#include "common/vocabulary/vocabulary.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "common/base/log.h"
#include "common/features/matcher.h"

namespace panofix {
namespace {

// Counts of equal words, weighted, unit length times `norm`.
void AppendHalf(std::span<const std::uint32_t> words, const std::vector<float>& idf, float norm,
                BagOfWords* bag) {
  std::vector<std::uint32_t> sorted(words.begin(), words.end());
  std::sort(sorted.begin(), sorted.end());
  const std::size_t first = bag->size();
  double sum_sq = 0;
  for (std::size_t i = 0; i < sorted.size();) {
    std::size_t j = i;
    while (j < sorted.size() && sorted[j] == sorted[i]) ++j;
    const float idf_i = sorted[i] < idf.size() ? idf[sorted[i]] : 0.0F;
    const float weight = static_cast<float>(j - i) * idf_i;
    if (weight > 0) {
      bag->push_back({sorted[i], weight});
      sum_sq += double{weight} * weight;
    }
    i = j;
  }
  const float scale = sum_sq > 0 ? norm / static_cast<float>(std::sqrt(sum_sq)) : 0.0F;
  for (std::size_t i = first; i < bag->size(); ++i) (*bag)[i].weight *= scale;
}

}  // namespace

std::uint32_t VocabularyTree::Quantize(const std::uint8_t* descriptor) const {
  std::uint32_t node = 0;
  while (num_children[node] > 0) {
    int best = std::numeric_limits<int>::max();
    std::uint32_t next = first_child[node];
    for (std::uint32_t child = first_child[node]; child < first_child[node] + num_children[node];
         ++child) {
      const int distance =
          DescriptorDistanceSq(descriptor, &centroids[std::size_t{child} * kDescriptorSize]);
      if (distance < best) best = distance, next = child;
    }
    node = next;
  }
  return word[node];
}

void VocabularyTree::QuantizeSoft(const std::uint8_t* descriptor, int count,
                                  std::vector<std::uint32_t>* words) const {
  std::vector<std::pair<int, std::uint32_t>> beam = {{0, 0}}, next;
  for (bool is_open = true; is_open;) {
    is_open = false;
    next.clear();
    for (const auto& [distance, node] : beam) {
      if (num_children[node] == 0) next.emplace_back(distance, node);
      for (std::uint32_t i = 0; i < num_children[node]; ++i) {
        const std::uint32_t child = first_child[node] + i;
        next.emplace_back(
            DescriptorDistanceSq(descriptor, &centroids[std::size_t{child} * kDescriptorSize]),
            child);
      }
    }
    const auto keep = std::min(next.size(), static_cast<std::size_t>(count));
    std::partial_sort(next.begin(), next.begin() + static_cast<std::ptrdiff_t>(keep), next.end());
    next.resize(keep);
    beam = next;
    for (const auto& [distance, node] : beam) is_open = is_open || num_children[node] > 0;
  }
  words->clear();
  for (const auto& [distance, node] : beam) words->push_back(word[node]);
}

Status VocabularyTree::Check() const {
  const std::size_t nodes = first_child.size();
  if (num_children.size() != nodes || word.size() != nodes ||
      centroids.size() != nodes * kDescriptorSize) {
    return {ErrorCode::kBadData, "vocabulary tree: arrays disagree in length"};
  }
  if (nodes == 0) {
    return num_words == 0 ? Status()
                          : Status(ErrorCode::kBadData, "vocabulary tree: words without nodes");
  }
  if (num_words > nodes) return {ErrorCode::kBadData, "vocabulary tree: more words than nodes"};
  std::vector<bool> seen(num_words, false);
  std::size_t num_seen = 0;
  for (std::size_t node = 0; node < nodes; ++node) {
    const std::size_t first = first_child[node], count = num_children[node];
    // Children come after their parent, so descent ends; every leaf is a word of its own.
    const bool sound = count == 0 ? word[node] < num_words && !seen[word[node]]
                                  : first > node && first + count <= nodes;
    if (!sound)
      return {ErrorCode::kBadData, Format("vocabulary tree: node %zu is not sound", node)};
    if (count == 0) seen[word[node]] = true, ++num_seen;
  }
  if (num_seen != num_words) return {ErrorCode::kBadData, "vocabulary tree: a word has no leaf"};
  return {};
}

float Similarity(const BagOfWords& a, const BagOfWords& b) {
  float sum = 0;
  for (std::size_t i = 0, j = 0; i < a.size() && j < b.size();) {
    if (a[i].word < b[j].word) {
      ++i;
    } else if (b[j].word < a[i].word) {
      ++j;
    } else {
      sum += a[i++].weight * b[j++].weight;
    }
  }
  return sum;
}

std::vector<std::uint32_t> Vocabulary::SiftWords(const FeatureSet& features) const {
  std::vector<std::uint32_t> words;
  if (sift.empty()) return words;
  for (std::size_t i = 0; i < features.size(); ++i)
    words.push_back(sift.Quantize(features.descriptor(i).data()));
  return words;
}

std::vector<std::uint32_t> Vocabulary::MserWords(const FeatureSet& features) const {
  std::vector<std::uint32_t> words;
  if (mser.empty()) return words;
  for (std::size_t i = 0; i < features.size(); ++i) {
    words.push_back(sift.num_words + mser.Quantize(features.descriptor(i).data()));
  }
  return words;
}

BagOfWords Vocabulary::Bag(std::span<const std::uint32_t> sift_words,
                           std::span<const std::uint32_t> mser_words) const {
  const auto has_weight = [&](std::span<const std::uint32_t> words) {
    return std::any_of(words.begin(), words.end(),
                       [&](std::uint32_t word) { return word < idf.size() && idf[word] > 0; });
  };
  // A half of words that every view has weighs nothing and must not take half of the length.
  const float norm = has_weight(sift_words) && has_weight(mser_words) ? std::sqrt(0.5F) : 1.0F;
  BagOfWords bag;
  AppendHalf(sift_words, idf, norm, &bag);
  AppendHalf(mser_words, idf, norm, &bag);
  return bag;
}

Status Vocabulary::Check() const {
  for (const VocabularyTree* tree : {&sift, &mser}) {
    Status status = tree->Check();
    if (!status.ok()) return status;
  }
  if (idf.size() != num_words())
    return {ErrorCode::kBadData, "vocabulary: one idf a word is needed"};
  for (const float value : idf) {
    if (!(value >= 0 && value < 100)) return {ErrorCode::kBadData, "vocabulary: idf out of range"};
  }
  return {};
}

std::vector<float> InverseDocumentFrequency(std::span<const std::uint32_t> views_with,
                                            std::uint64_t num_views) {
  std::vector<float> idf(views_with.size(), 0.0F);
  for (std::size_t i = 0; i < idf.size(); ++i) {
    if (views_with[i] > 0)
      idf[i] = static_cast<float>(std::log(static_cast<double>(num_views) / views_with[i]));
  }
  return idf;
}

InvertedIndex::InvertedIndex(std::span<const BagOfWords> bags) : num_views_(bags.size()) {
  std::uint32_t num_words = 0;
  for (const BagOfWords& bag : bags) {
    for (const WeightedWord& entry : bag) num_words = std::max(num_words, entry.word + 1);
  }
  // Counting sort: a slot a word, for the time of this function.
  std::vector<std::uint32_t> next(num_words, 0);
  for (const BagOfWords& bag : bags) {
    for (const WeightedWord& entry : bag) ++next[entry.word];
  }
  std::uint32_t begin = 0;
  for (std::uint32_t word = 0; word < num_words; ++word) {
    const std::uint32_t count = std::exchange(next[word], begin);
    if (count > 0) words_.push_back(word), offsets_.push_back(begin);
    begin += count;
  }
  offsets_.push_back(begin);
  views_.resize(begin);
  weights_.resize(begin);
  for (std::size_t view = 0; view < bags.size(); ++view) {
    for (const WeightedWord& entry : bags[view]) {
      const std::uint32_t slot = next[entry.word]++;
      views_[slot] = static_cast<std::uint32_t>(view);
      weights_[slot] = entry.weight;
    }
  }
}

std::vector<float> InvertedIndex::Score(const BagOfWords& query) const {
  std::vector<float> scores(num_views_, 0.0F);
  auto from = words_.begin();  // both are sorted
  for (const WeightedWord& entry : query) {
    from = std::lower_bound(from, words_.end(), entry.word);
    if (from == words_.end()) break;
    if (*from != entry.word) continue;
    const auto row = static_cast<std::size_t>(from - words_.begin());
    for (std::uint32_t slot = offsets_[row]; slot < offsets_[row + 1]; ++slot) {
      scores[views_[slot]] += entry.weight * weights_[slot];
    }
  }
  return scores;
}

std::size_t InvertedIndex::num_bytes() const {
  return 4 * (words_.capacity() + offsets_.capacity() + views_.capacity() + weights_.capacity());
}

}  // namespace panofix
