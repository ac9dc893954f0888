#pragma once
// Streets of panoramas, and the similarity that retrieval would give a frame in them.

#include <algorithm>
#include <cmath>
#include <vector>

#include "common/base/rng.h"
#include "runtime/tracking/place_filter.h"

namespace panofix {

inline constexpr double kGap_m = 10;
// As measured on real and generated streets: unrelated places about 0.15, within 10 %; the right
// one up to twice that, falling off over some 10 m, and unseen in some frames.
inline constexpr double kUnrelated = 0.15, kUnrelatedSigma = 0.015, kRight = 0.32, kFade_m = 8;

// `count` panoramas on a straight street from `start`, linked in a row behind those there are.
inline void AddStreet(const Eigen::Vector3d& start, std::uint32_t count, PlaceGraph* graph) {
  for (std::uint32_t i = 0; i < count; ++i) {
    const auto idx = static_cast<std::uint32_t>(graph->positions_in_map.size());
    graph->positions_in_map.push_back(start + i * Eigen::Vector3d(kGap_m, 0, 0));
    graph->links.emplace_back();
    if (i > 0) graph->links[idx].push_back(idx - 1);
  }
}
inline PlaceGraph Street(std::uint32_t count) {
  PlaceGraph graph;
  AddStreet(Eigen::Vector3d::Zero(), count, &graph);
  return graph;
}

// Scores of a frame that shows no place of the map.
inline std::vector<float> UnrelatedScores(std::size_t count, Rng* rng) {
  std::vector<float> scores(count);
  for (float& score : scores) {
    score = static_cast<float>(std::max(0.0, kUnrelated + kUnrelatedSigma * rng->Normal()));
  }
  return scores;
}

// Adds what a camera at `position` sees of each panorama.
inline void AddSight(const PlaceGraph& graph, const Eigen::Vector3d& position,
                     std::vector<float>* scores) {
  for (std::size_t p = 0; p < scores->size(); ++p) {
    const double z = (graph.positions_in_map[p] - position).norm() / kFade_m;
    (*scores)[p] += static_cast<float>((kRight - kUnrelated) * std::exp(-0.5 * z * z));
  }
}

inline std::vector<float> ScoresAt(const PlaceGraph& graph, const Eigen::Vector3d& position,
                                   Rng* rng) {
  std::vector<float> scores = UnrelatedScores(graph.positions_in_map.size(), rng);
  AddSight(graph, position, &scores);
  return scores;
}

// What every state must be: whole and finite.
inline double TotalBelief(const PlaceFilter& filter) {
  double total = filter.off_map();
  for (const double belief : filter.belief()) {
    if (!(belief >= 0)) return std::nan("");
    total += belief;
  }
  return total;
}

}  // namespace panofix
