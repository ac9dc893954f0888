#include "builder/train/tree_trainer.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <limits>
#include <set>
#include <stdexcept>

#include "common/base/cancel.h"
#include "common/features/matcher.h"
#include "tests/common/features/random_descriptors.h"

namespace panofix {
namespace {

constexpr std::size_t kSize = kDescriptorSize;
using Bytes = std::vector<std::uint8_t>;

TreeOptions Options(int num_words, int branching = 10) {
  TreeOptions options;
  options.num_words = num_words, options.branching = branching;
  return options;
}

std::uint32_t NumLeaves(const VocabularyTree& tree) {
  return static_cast<std::uint32_t>(
      std::count(tree.num_children.begin(), tree.num_children.end(), 0U));
}

std::set<std::uint32_t> WordsOf(const VocabularyTree& tree, const Bytes& descriptors) {
  std::set<std::uint32_t> words;
  for (std::size_t i = 0; i < descriptors.size(); i += kSize)
    words.insert(tree.Quantize(&descriptors[i]));
  return words;
}

// Well separated groups of 30, disturbed copies of a random centre each.
Bytes Groups(std::size_t count, Rng* rng) {
  Bytes bytes;
  for (std::size_t g = 0; g < count; ++g) {
    const Bytes centre = RandomDescriptors(1, rng);
    for (int i = 0; i < 30; ++i) {
      const Bytes copy = Disturbed(centre, 3, rng);
      bytes.insert(bytes.end(), copy.begin(), copy.end());
    }
  }
  return bytes;
}

TEST(TrainTree, MeetsTheNumberOfWordsExactly) {
  Rng rng(1, "tests/exact");
  const Bytes descriptors = RandomDescriptors(3000, &rng);
  for (const int words : {2, 9, 10, 11, 99, 100, 101, 517, 1000}) {
    const VocabularyTree tree = TrainTree(descriptors, Options(words), "tests");
    EXPECT_TRUE(tree.Check().ok()) << tree.Check().message();
    EXPECT_EQ(tree.num_words, static_cast<std::uint32_t>(words));
    EXPECT_EQ(NumLeaves(tree), tree.num_words);
  }
}

TEST(TrainTree, AsManyWordsAsDistinctDescriptors) {
  Rng rng(1, "tests/all");
  const Bytes descriptors = RandomDescriptors(400, &rng);
  for (const int branching : {2, 3, 10, 64}) {
    EXPECT_EQ(TrainTree(descriptors, Options(400, branching), "tests").num_words, 400U)
        << branching;
    EXPECT_EQ(TrainTree(descriptors, Options(300, branching), "tests").num_words, 300U)
        << branching;
  }
}

TEST(TrainTree, FewerDistinctDescriptorsThanWords) {
  Rng rng(1, "tests/fewer");
  const Bytes distinct = RandomDescriptors(7, &rng);
  Bytes descriptors;
  for (int copy = 0; copy < 40; ++copy)
    descriptors.insert(descriptors.end(), distinct.begin(), distinct.end());
  const VocabularyTree tree = TrainTree(descriptors, Options(50, 3), "tests");
  EXPECT_TRUE(tree.Check().ok());
  EXPECT_EQ(tree.num_words, 7U);
  EXPECT_EQ(WordsOf(tree, distinct).size(), 7U);
}

TEST(TrainTree, OneDescriptorOrNone) {
  const VocabularyTree lone = TrainTree(Bytes(kSize, 5), Options(10), "tests");
  EXPECT_TRUE(lone.Check().ok());
  EXPECT_EQ(lone.num_words, 1U);
  EXPECT_TRUE(TrainTree({}, Options(10), "tests").empty());
  EXPECT_EQ(TrainTree(Bytes(kSize * 50, 5), Options(10), "tests").num_words, 1U);
}

TEST(TrainTree, SeparatesWhatIsApart) {
  Rng rng(1, "tests/groups");
  const Bytes descriptors = Groups(12, &rng);
  TreeOptions options = Options(12, 12);
  const VocabularyTree tree = TrainTree(descriptors, options, "tests");
  std::set<std::uint32_t> seen;
  for (std::size_t g = 0; g < 12; ++g) {
    const Bytes group(&descriptors[g * 30 * kSize], &descriptors[g * 30 * kSize] + 30 * kSize);
    const auto words = WordsOf(tree, group);
    EXPECT_EQ(words.size(), 1U) << "group " << g << " is torn apart";
    seen.insert(words.begin(), words.end());
  }
  // k-means may join two groups of twelve; it must not join many.
  EXPECT_GE(seen.size(), 11U);
}

// Every leaf's centroid of a one-level tree is the mean of what falls into it, after convergence.
TEST(TrainTree, CentroidsAreMeans) {
  Rng rng(1, "tests/means");
  const Bytes descriptors = RandomDescriptors(500, &rng, 60);
  TreeOptions options = Options(8, 8);
  options.max_iterations = 1000;
  const VocabularyTree tree = TrainTree(descriptors, options, "tests");
  ASSERT_EQ(tree.num_words, 8U);
  std::vector<std::vector<double>> sums(8, std::vector<double>(kSize, 0));
  std::vector<double> counts(8, 0);
  for (std::size_t i = 0; i < descriptors.size(); i += kSize) {
    const std::uint32_t word = tree.Quantize(&descriptors[i]);
    ++counts[word];
    for (std::size_t d = 0; d < kSize; ++d)
      sums[word][d] += static_cast<double>(descriptors[i + d]);
  }
  for (std::size_t node = 1; node <= 8; ++node) {
    const std::uint32_t word = tree.word[node];
    for (std::size_t d = 0; d < kSize; ++d) {
      const auto centroid = static_cast<double>(tree.centroids[node * kSize + d]);
      EXPECT_NEAR(centroid, sums[word][d] / counts[word], 0.5 + 1e-9);
    }
  }
}

void ExpectSameTree(const VocabularyTree& a, const VocabularyTree& b) {
  EXPECT_EQ(a.centroids, b.centroids);
  EXPECT_EQ(a.first_child, b.first_child);
  EXPECT_EQ(a.num_children, b.num_children);
  EXPECT_EQ(a.word, b.word);
}

TEST(TrainTree, DoesNotDependOnThreads) {
  Rng rng(1, "tests/threads");
  const Bytes descriptors = RandomDescriptors(4000, &rng);
  VocabularyTree one;
  {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
    one = TrainTree(descriptors, Options(300), "tests");
  }
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 2);
  ExpectSameTree(one, TrainTree(descriptors, Options(300), "tests"));
}

TEST(TrainTree, SeedAndStreamDecide) {
  Rng rng(1, "tests/seed");
  const Bytes descriptors = RandomDescriptors(500, &rng);
  TreeOptions options = Options(40);
  const VocabularyTree tree = TrainTree(descriptors, options, "a");
  EXPECT_NE(TrainTree(descriptors, options, "b").centroids, tree.centroids);
  options.seed = 2;
  EXPECT_NE(TrainTree(descriptors, options, "a").centroids, tree.centroids);
}

TEST(TrainTree, CtrlCEndsIt) {
  Rng rng(1, "tests/cancel");
  const Bytes descriptors = RandomDescriptors(100, &rng);
  RequestCancel();
  try {
    (void)TrainTree(descriptors, Options(10), "tests");
    ADD_FAILURE() << "nothing was thrown";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::kCancelled);
  }
  ClearCancel();
}

TEST(TreeOptions, CheckRefusesWhatMakesNoTree) {
  EXPECT_NO_THROW(TreeOptions().Check());
  EXPECT_THROW(Options(1).Check(), std::invalid_argument);
  EXPECT_THROW(Options(100, 1).Check(), std::invalid_argument);
  EXPECT_THROW(Options(100, 65).Check(), std::invalid_argument);
  TreeOptions options;
  options.max_iterations = 0;
  EXPECT_THROW(options.Check(), std::invalid_argument);
}

}  // namespace
}  // namespace panofix
