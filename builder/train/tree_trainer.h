#pragma once
// Trains a vocabulary tree by hierarchical k-means.

#include <cstdint>
#include <span>
#include <string>

#include "common/vocabulary/vocabulary.h"

namespace panofix {

struct TreeOptions {
  int num_words = 5000;  // leaves wanted; fewer come out where there are fewer distinct descriptors
  int branching = 10;    // children a node; the depth follows
  int max_iterations = 12;  // of Lloyd's algorithm a node; it stops early once nothing moves
  std::uint64_t seed = 1;
  void Check() const;  // throws std::invalid_argument
};

// Hierarchical k-means (k-means++ seeding, Arthur and Vassilvitskii, SODA 2007) over N x 128 bytes.
// Each node's share of the words follows its share of the descriptors, so that the number of leaves
// is met exactly. Sums are integers: the same tree for any number of threads. `stream` names the
// random stream, e.g. "train/sift".
[[nodiscard]] VocabularyTree TrainTree(std::span<const std::uint8_t> descriptors,
                                       const TreeOptions& options, const std::string& stream);

}  // namespace panofix
