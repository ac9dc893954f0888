#pragma once
// Vocabulary trees with random centroids.

#include "common/vocabulary/vocabulary.h"
#include "tests/common/features/random_descriptors.h"

namespace panofix {

// Full tree of `depth` levels below the root, `branching` children a node, breadth first.
inline VocabularyTree RandomTree(std::uint32_t branching, int depth, Rng* rng) {
  VocabularyTree tree;
  std::uint32_t level_size = 1, next = 1;
  for (int level = 0; level <= depth; ++level) {
    for (std::uint32_t i = 0; i < level_size; ++i) {
      const bool leaf = level == depth;
      tree.first_child.push_back(leaf ? 0 : next);
      tree.num_children.push_back(leaf ? 0 : branching);
      tree.word.push_back(leaf ? tree.num_words++ : 0);
      if (!leaf) next += branching;
    }
    level_size *= branching;
  }
  tree.centroids = RandomDescriptors(tree.word.size(), rng);
  return tree;
}

// Two trees and an idf between 0.1 and 5; the words come with it.
inline Vocabulary RandomVocabulary(Rng* rng) {
  Vocabulary vocabulary;
  vocabulary.sift = RandomTree(6, 2, rng);
  vocabulary.mser = RandomTree(4, 2, rng);
  for (std::uint32_t i = 0; i < vocabulary.num_words(); ++i) {
    vocabulary.idf.push_back(static_cast<float>(rng->Uniform(0.1, 5)));
  }
  return vocabulary;
}

}  // namespace panofix
