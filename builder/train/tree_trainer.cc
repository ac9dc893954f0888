#include "builder/train/tree_trainer.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstring>
#include <deque>
#include <limits>
#include <numeric>
#include <stdexcept>

#include "common/base/cancel.h"
#include "common/base/log.h"
#include "common/base/rng.h"
#include "common/features/matcher.h"

namespace panofix {
namespace {

constexpr std::size_t kSize = kDescriptorSize;
using Members = std::vector<std::uint32_t>;
using Centroids = std::vector<std::uint8_t>;

// Nearest of the centroids for every member; first of equals.
std::vector<std::uint8_t> Assign(std::span<const std::uint8_t> descriptors, const Members& members,
                                 const Centroids& centroids) {
  std::vector<std::uint8_t> nearest(members.size());
  const std::size_t k = centroids.size() / kSize;
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(0, members.size(), 512), [&](const auto& range) {
        for (std::size_t i = range.begin(); i < range.end(); ++i) {
          int best = std::numeric_limits<int>::max();
          for (std::size_t c = 0; c < k; ++c) {
            const int distance =
                DescriptorDistanceSq(&descriptors[members[i] * kSize], &centroids[c * kSize]);
            if (distance < best) best = distance, nearest[i] = static_cast<std::uint8_t>(c);
          }
        }
      });
  return nearest;
}

// k-means++: each next seed with probability proportional to its squared distance to those chosen.
Centroids SeedCentroids(std::span<const std::uint8_t> descriptors, const Members& members, int k,
                        Rng* rng) {
  Centroids centroids;
  std::vector<std::int64_t> distance(members.size(), std::numeric_limits<int>::max());
  std::size_t chosen = rng->Below(members.size());
  while (true) {
    const std::uint8_t* seed = &descriptors[members[chosen] * kSize];
    centroids.insert(centroids.end(), seed, seed + kSize);
    if (centroids.size() == static_cast<std::size_t>(k) * kSize) return centroids;
    std::int64_t total = 0;
    for (std::size_t i = 0; i < members.size(); ++i) {
      const std::int64_t d = DescriptorDistanceSq(seed, &descriptors[members[i] * kSize]);
      distance[i] = std::min(distance[i], d);
      total += distance[i];
    }
    if (total == 0) return centroids;  // fewer distinct descriptors than k
    auto target = static_cast<std::int64_t>(rng->Below(static_cast<std::uint64_t>(total)));
    chosen = 0;
    while (target >= distance[chosen]) target -= distance[chosen++];
  }
}

// Means of the assigned members, rounded; an empty cluster keeps its centroid.
Centroids Update(std::span<const std::uint8_t> descriptors, const Members& members,
                 const std::vector<std::uint8_t>& nearest, const Centroids& old) {
  const std::size_t k = old.size() / kSize;
  std::vector<std::int64_t> sums(k * kSize, 0), counts(k, 0);
  for (std::size_t i = 0; i < members.size(); ++i) {
    ++counts[nearest[i]];
    for (std::size_t d = 0; d < kSize; ++d)
      sums[nearest[i] * kSize + d] += descriptors[members[i] * kSize + d];
  }
  Centroids centroids = old;
  for (std::size_t c = 0; c < k; ++c) {
    if (counts[c] == 0) continue;
    for (std::size_t d = 0; d < kSize; ++d) {
      centroids[c * kSize + d] =
          static_cast<std::uint8_t>((2 * sums[c * kSize + d] + counts[c]) / (2 * counts[c]));
    }
  }
  return centroids;
}

struct Cluster {
  Centroids centroid;
  Members members;
  int num_distinct = 0;  // different descriptors among the members: no more words than these
};

// Numbers equal descriptors alike, to count the different ones of a cluster.
class DistinctCounter {
 public:
  explicit DistinctCounter(std::span<const std::uint8_t> descriptors)
      : group_(descriptors.size() / kSize) {
    Members order(group_.size());
    std::iota(order.begin(), order.end(), 0U);
    const auto compare = [&](std::uint32_t a, std::uint32_t b) {
      return std::memcmp(&descriptors[a * kSize], &descriptors[b * kSize], kSize);
    };
    std::sort(order.begin(), order.end(),
              [&](std::uint32_t a, std::uint32_t b) { return compare(a, b) < 0; });
    std::uint32_t group = 0;
    for (std::size_t i = 0; i < order.size(); ++i) {
      if (i > 0 && compare(order[i - 1], order[i]) != 0) ++group;
      group_[order[i]] = group;
    }
    last_call_.assign(group_.size(), 0);
  }
  int Count(const Members& members) {
    ++call_;
    int count = 0;
    for (const std::uint32_t member : members) {
      std::uint32_t& last = last_call_[group_[member]];
      if (last != call_) last = call_, ++count;
    }
    return count;
  }

 private:
  std::vector<std::uint32_t> group_, last_call_;
  std::uint32_t call_ = 0;
};

// Splits members in at most k non-empty clusters.
std::vector<Cluster> Split(std::span<const std::uint8_t> descriptors, const Members& members, int k,
                           int max_iterations, Rng* rng) {
  Centroids centroids = SeedCentroids(descriptors, members, k, rng);
  std::vector<std::uint8_t> nearest = Assign(descriptors, members, centroids);
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    Centroids updated = Update(descriptors, members, nearest, centroids);
    if (updated == centroids) break;
    centroids = std::move(updated);
    nearest = Assign(descriptors, members, centroids);
  }
  std::vector<Cluster> clusters(centroids.size() / kSize);
  for (std::size_t i = 0; i < members.size(); ++i)
    clusters[nearest[i]].members.push_back(members[i]);
  for (std::size_t c = 0; c < clusters.size(); ++c) {
    clusters[c].centroid.assign(&centroids[c * kSize], &centroids[c * kSize] + kSize);
  }
  std::erase_if(clusters, [](const Cluster& cluster) { return cluster.members.empty(); });
  return clusters;
}

// Shares `words` among the clusters by size, at least one each, exactly (largest remainder). What a
// cluster has no different descriptors for goes to the others, one at a time, the largest first.
std::vector<int> ShareWords(const std::vector<Cluster>& clusters, int words) {
  std::int64_t total = 0;
  for (const Cluster& cluster : clusters)
    total += static_cast<std::int64_t>(cluster.members.size());
  const int spare = words - static_cast<int>(clusters.size());
  std::vector<int> share(clusters.size(), 1);
  std::vector<std::pair<std::int64_t, std::size_t>> remainder;
  int given = 0;
  for (std::size_t c = 0; c < clusters.size(); ++c) {
    const std::int64_t exact = spare * static_cast<std::int64_t>(clusters[c].members.size());
    share[c] += static_cast<int>(exact / total);
    given += static_cast<int>(exact / total);
    remainder.emplace_back(-(exact % total), c);
  }
  std::sort(remainder.begin(), remainder.end());
  for (int i = 0; i < spare - given; ++i) ++share[remainder[static_cast<std::size_t>(i)].second];
  int left_over = 0;
  std::vector<std::pair<std::int64_t, std::size_t>> by_size;
  for (std::size_t c = 0; c < clusters.size(); ++c) {
    const int excess = std::max(0, share[c] - clusters[c].num_distinct);
    share[c] -= excess, left_over += excess;
    by_size.emplace_back(-static_cast<std::int64_t>(clusters[c].members.size()), c);
  }
  std::sort(by_size.begin(), by_size.end());
  for (bool given_any = true; left_over > 0 && given_any;) {
    given_any = false;
    for (const auto& [size, c] : by_size) {
      if (left_over == 0 || share[c] >= clusters[c].num_distinct) continue;
      ++share[c], --left_over, given_any = true;
    }
  }
  return share;
}

struct Pending {
  std::uint32_t node;
  Members members;
  int words;
};

std::uint32_t AddNode(VocabularyTree* tree, const Centroids& centroid) {
  tree->centroids.insert(tree->centroids.end(), centroid.begin(), centroid.end());
  tree->first_child.push_back(0);
  tree->num_children.push_back(0);
  tree->word.push_back(0);
  return static_cast<std::uint32_t>(tree->word.size() - 1);
}

}  // namespace

void TreeOptions::Check() const {
  const auto require = [](bool holds, const std::string& message) {
    if (!holds) throw std::invalid_argument(message);
  };
  require(num_words >= 2 && num_words <= 4'000'000,
          Format("num_words = %d; must lie in 2..4000000", num_words));
  require(branching >= 2 && branching <= 64,
          Format("branching = %d; must lie in 2..64", branching));
  require(max_iterations >= 1, Format("max_iterations = %d; must be at least 1", max_iterations));
}

VocabularyTree TrainTree(std::span<const std::uint8_t> descriptors, const TreeOptions& options,
                         const std::string& stream) {
  options.Check();
  VocabularyTree tree;
  if (descriptors.empty()) return tree;
  Members all(descriptors.size() / kSize);
  std::iota(all.begin(), all.end(), 0U);
  DistinctCounter distinct(descriptors);
  std::deque<Pending> pending;
  pending.push_back({AddNode(&tree, Centroids(kSize, 0)), std::move(all), options.num_words});
  while (!pending.empty()) {
    if (CancelRequested()) throw Error(ErrorCode::kCancelled, "training stopped by the user");
    const Pending job = std::move(pending.front());
    pending.pop_front();
    std::vector<Cluster> clusters;
    if (job.words > 1 && job.members.size() > 1) {
      Rng rng(options.seed, stream + "/" + std::to_string(job.node));
      clusters = Split(descriptors, job.members, std::min(options.branching, job.words),
                       options.max_iterations, &rng);
    }
    if (clusters.size() < 2) {
      tree.word[job.node] = tree.num_words++;
      continue;
    }
    for (Cluster& cluster : clusters) cluster.num_distinct = distinct.Count(cluster.members);
    const std::vector<int> share = ShareWords(clusters, job.words);
    tree.num_children[job.node] = static_cast<std::uint32_t>(clusters.size());
    for (std::size_t c = 0; c < clusters.size(); ++c) {
      const std::uint32_t child = AddNode(&tree, clusters[c].centroid);
      if (c == 0) tree.first_child[job.node] = child;
      pending.push_back({child, std::move(clusters[c].members), share[c]});
    }
  }
  return tree;
}

}  // namespace panofix
