#pragma once
// Where on the map the vehicle may be: a discrete Bayes filter over the panoramas and OFF_MAP.

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "runtime/tracking/place_roads.h"

namespace panofix {

struct PlaceFilterOptions {
  double max_speed_mps = 30;      // what is reachable between two frames along the roads
  double reach_margin_m = 12;     // and so much further: panoramas stand this far apart
  double teleport_share = 0.02;   // a second: frames were lost, it was towed, the filter was wrong
  double leave_share = 0.02;      // a second: to OFF_MAP, and back; at most 0.5
  double off_map_likelihood = 1;  // of any frame off the map, where the best score that chance
                                  // gives has likelihood 1
  void Check() const;             // throws std::invalid_argument naming field, value and rule
};

// No odometry, no start position: it starts knowing nothing. Frames may stop, jump, repeat, run
// backwards or leave the map. Deterministic; never NaN; belief and OFF_MAP sum to 1 at all times.
// Memory grows with the number of panoramas; so does an update, by a few operations each. Not
// thread-safe.
class PlaceFilter {
 public:
  // Throws std::invalid_argument where an option or the graph breaks its rule.
  PlaceFilter(const PlaceGraph& graph, const PlaceFilterOptions& options);
  // Forgets everything: half OFF_MAP, the rest equal.
  void Reset();
  // Moves belief on by what a vehicle can do in `dt_s`: along the roads within max_speed_mps * dt_s
  // + reach_margin_m, likelier near than far (exp(-2 d / reach)), to the 256 nearest at most; by
  // the teleport share anywhere; by the leave share off the map and back. A panorama that holds
  // less than 0.02 % stays put and only teleports. 0, negative or not finite: as after Reset, time
  // tells nothing.
  void Predict(double dt_s);
  // Weighs places by how alike the frame is to each: `similarity[p]` is the cosine of the best view
  // of panorama p, in [0, 1], 0 where no word is shared; one for each panorama, or
  // std::invalid_argument. A place gains by how far it stands out of the scores of this very frame,
  // because their level moves with vocabulary and texture: at most a factor of 20 between the best
  // and the worst place, whatever the frame. Scores all alike say nothing.
  void UpdateSimilarity(std::span<const float> similarity);
  // A fix at a position, metres, with its horizontal sigma: belief gathers there. One in twenty may
  // be wrong and lie anywhere. Without effect where a value is not finite or the sigma negative.
  void UpdateFix(const Eigen::Vector3d& position_in_map, double sigma_m);
  // The place was searched and nothing stood the tests: it loses by half, to elsewhere and OFF_MAP.
  // Repeats count once; throws std::invalid_argument for an index that is no panorama.
  void UpdateNoFix(std::span<const std::uint32_t> searched);

  // Of each panorama; sums to 1 - off_map().
  [[nodiscard]] std::span<const double> belief() const { return belief_; }
  [[nodiscard]] double off_map() const { return off_map_; }
  // Fewest panoramas that together hold `share` of the belief on the map, best first (equals by
  // index), at most `most`.
  [[nodiscard]] std::vector<std::uint32_t> Likely(double share, std::size_t most) const;
  // Belief within `radius_m` of a position: what the past says of a place.
  [[nodiscard]] double BeliefNear(const Eigen::Vector3d& position_in_map, double radius_m) const;

 private:
  // Multiplies the belief of panorama p by likelihood_[p] and OFF_MAP by its own, sum 1 again.
  // Resets where nothing is left.
  void Weigh(double off_map_likelihood);
  void Normalize();

  PlaceFilterOptions options_;
  std::vector<Eigen::Vector3d> positions_in_map_;
  PlaceRoads roads_;
  std::vector<double> belief_;
  std::vector<double> moved_, likelihood_;  // work space, one a panorama
  double off_map_ = 0;
};

}  // namespace panofix
