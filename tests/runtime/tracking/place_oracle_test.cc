// The sparse filter against a dense one that knows all distances: every state in every step.
#include <gtest/gtest.h>

#include "tests/runtime/tracking/street_scores.h"

namespace panofix {
namespace {

constexpr double kTolerance = 1e-11;  // hundreds of roundings of numbers below 1
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Road lengths between all pairs by Floyd and Warshall: links, and what stands within `near_m`.
Eigen::MatrixXd AllDistances(const PlaceGraph& graph, double near_m) {
  const auto n = static_cast<Eigen::Index>(graph.positions_in_map.size());
  Eigen::MatrixXd d = Eigen::MatrixXd::Constant(n, n, kInfinity);
  const auto length = [&](Eigen::Index a, Eigen::Index b) {
    return (graph.positions_in_map[static_cast<std::size_t>(a)] -
            graph.positions_in_map[static_cast<std::size_t>(b)])
        .norm();
  };
  for (Eigen::Index a = 0; a < n; ++a) {
    for (Eigen::Index b = 0; b < n; ++b) {
      if (length(a, b) <= near_m) d(a, b) = length(a, b);
    }
    for (const std::uint32_t b : graph.links[static_cast<std::size_t>(a)]) {
      d(a, b) = d(b, a) = length(a, b);
    }
  }
  for (Eigen::Index k = 0; k < n; ++k) {
    for (Eigen::Index a = 0; a < n; ++a) {
      for (Eigen::Index b = 0; b < n; ++b) d(a, b) = std::min(d(a, b), d(a, k) + d(k, b));
    }
  }
  return d;
}

// The motion as PlaceFilter::Predict states it, as one (n + 1) x (n + 1) matrix over the places and
// OFF_MAP; columns are where belief comes from. Those with less than 0.02 % stay put.
Eigen::MatrixXd Transition(const Eigen::MatrixXd& distances, const Eigen::VectorXd& state,
                           const PlaceFilterOptions& options, double dt_s) {
  const Eigen::Index n = distances.rows();
  const double reach_m = options.max_speed_mps * dt_s + options.reach_margin_m;
  const double teleports = 1 - std::pow(1 - options.teleport_share, dt_s);
  const double crosses = (1 - std::pow(1 - 2 * options.leave_share, dt_s)) / 2;
  Eigen::MatrixXd T = Eigen::MatrixXd::Zero(n + 1, n + 1);
  for (Eigen::Index from = 0; from < n; ++from) {
    Eigen::VectorXd flow = Eigen::VectorXd::Unit(n, from);
    if (state[from] >= 2e-4) {
      flow = (distances.col(from).array() <= reach_m)
                 .select((-2 / reach_m * distances.col(from).array()).exp(), 0.0)
                 .matrix();
      flow /= flow.sum();
    }
    flow = (1 - teleports) * flow.array() + teleports / static_cast<double>(n);
    T.col(from).head(n) = (1 - crosses) * flow;
    T(n, from) = crosses;
  }
  T.col(n).head(n).setConstant(crosses / static_cast<double>(n));
  T(n, n) = 1 - crosses;
  return T;
}

// A crooked town: streets that cross, one that stands apart, and one link past its neighbours.
PlaceGraph CrookedTown(Rng* rng) {
  PlaceGraph graph;
  AddStreet({0, 0, 0}, 15, &graph);
  AddStreet({50, -40, 0}, 8, &graph);
  AddStreet({500, 300, 0}, 7, &graph);
  for (auto& position : graph.positions_in_map) {
    position += Eigen::Vector3d(2 * rng->Normal(), 2 * rng->Normal(), rng->Normal());
  }
  graph.links[15].push_back(6);
  graph.links[22].push_back(14);
  graph.links[3].push_back(9);
  return graph;
}

TEST(PlaceOracle, SparseEqualsDense) {
  Rng rng(11, "tests/place_oracle");
  const PlaceGraph graph = CrookedTown(&rng);
  const PlaceFilterOptions options;
  PlaceFilter filter(graph, options);
  const Eigen::MatrixXd distances = AllDistances(graph, options.reach_margin_m);
  const auto n = static_cast<Eigen::Index>(graph.positions_in_map.size());
  const auto state_of = [&] {
    Eigen::VectorXd state(n + 1);
    for (Eigen::Index p = 0; p < n; ++p) state[p] = filter.belief()[static_cast<std::size_t>(p)];
    state[n] = filter.off_map();
    return state;
  };
  for (int step = 0; step < 200; ++step) {
    const double dt_s = std::exp(rng.Uniform(std::log(0.02), std::log(30.0)));
    const Eigen::VectorXd before = state_of();
    filter.Predict(dt_s);
    const Eigen::VectorXd expected = Transition(distances, before, options, dt_s) * before;
    ASSERT_LT((state_of() - expected).cwiseAbs().maxCoeff(), kTolerance) << step << ", " << dt_s;
    // Evidence of all kinds in between, so that states of all shapes are moved.
    const Eigen::Vector3d at = graph.positions_in_map[rng.Below(30)];
    if (step % 3 == 0) filter.UpdateSimilarity(ScoresAt(graph, at, &rng));
    if (step % 7 == 0) filter.UpdateFix(at, rng.Uniform(0.1, 3));
    if (step % 5 == 0) filter.UpdateNoFix(filter.Likely(0.9, 5));
  }
}

// Neither the numbering of panoramas nor the end that names a link says anything of the place.
TEST(PlaceOracle, NumberingDoesNotMatter) {
  Rng rng(12, "tests/place_oracle");
  const PlaceGraph graph = CrookedTown(&rng);
  const std::size_t n = graph.positions_in_map.size();
  const auto turned = [&](std::size_t p) { return n - 1 - p; };
  PlaceGraph other;
  other.positions_in_map.resize(n);
  other.links.resize(n);
  for (std::size_t p = 0; p < n; ++p) {
    other.positions_in_map[turned(p)] = graph.positions_in_map[p];
    for (const std::uint32_t to : graph.links[p]) {
      other.links[turned(to)].push_back(static_cast<std::uint32_t>(turned(p)));
    }
  }
  PlaceFilter a(graph, {}), b(other, {});
  for (int step = 0; step < 40; ++step) {
    const Eigen::Vector3d at = graph.positions_in_map[static_cast<std::size_t>(step) % n];
    const std::vector<float> scores = ScoresAt(graph, at, &rng);
    const std::vector<float> reversed(scores.rbegin(), scores.rend());
    a.Predict(0.4);
    b.Predict(0.4);
    a.UpdateSimilarity(scores);
    b.UpdateSimilarity(reversed);
    for (std::size_t p = 0; p < n; ++p) {
      ASSERT_NEAR(a.belief()[p], b.belief()[turned(p)], kTolerance) << step;
    }
  }
}

}  // namespace
}  // namespace panofix
