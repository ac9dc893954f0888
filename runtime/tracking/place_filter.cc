#include "runtime/tracking/place_filter.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <string>

namespace panofix {
namespace {

constexpr double kOffMapAtStart = 0.5;    // knowing nothing: as likely off the map as on it
constexpr double kLeastMoved = 2e-4;      // a panorama with less belief stays put; bounds the work
constexpr std::size_t kMaxReached = 256;  // panoramas that one panorama's belief flows to

// Similarity. Measured on a street of Paris and on generated towns: scores of unrelated places
// spread by 12 % of their median or less, the best of them up to 1.6 times it, off the map as on
// it; the right place's lie at 1.8 to 7 times it, or, where the view has little texture of its own,
// among the unrelated: half of the frames of a town. Hence the bounds of the spread (a larger one
// is a street that looks like itself, no noise), and likelihoods that take little where a place
// looks like any other and give much where it stands out.
constexpr double kLeastSpreadShare = 0.12, kMostSpreadShare = 0.2;  // of the median
constexpr double kLeastSpread = 0.01;  // a score; where most places share no word
constexpr double kMadToSigma = 1.4826;
constexpr double kHeavyTail = 1.3;  // the best of n unrelated, over that of n normal ones
constexpr double kLeastLikelihood = 0.6, kMostLikelihood = 12;  // a factor of 20 apart
constexpr double kFewPlaces = 4;  // so few cannot say what unrelated looks like

constexpr double kWrongFixShare = 0.05;
constexpr double kSearchedInVain = 0.5;  // how often a right place gives no fix, and more: frames
                                         // behind one bus are not independent

void Require(bool holds, const char* field, double value, const char* rule) {
  if (holds) return;
  throw std::invalid_argument(std::string(field) + " = " + std::to_string(value) + "; must be " +
                              rule);
}

const PlaceFilterOptions& Checked(const PlaceFilterOptions& options) {
  options.Check();
  return options;
}

double MedianOf(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

void PlaceFilterOptions::Check() const {
  const auto is_length = [](double value) { return std::isfinite(value) && value >= 0; };
  Require(is_length(max_speed_mps), "max_speed_mps", max_speed_mps, "finite, not negative");
  Require(is_length(reach_margin_m), "reach_margin_m", reach_margin_m, "finite, not negative");
  Require(teleport_share >= 0 && teleport_share <= 1, "teleport_share", teleport_share,
          "in [0, 1]");
  Require(leave_share >= 0 && leave_share <= 0.5, "leave_share", leave_share, "in [0, 0.5]");
  Require(is_length(off_map_likelihood), "off_map_likelihood", off_map_likelihood,
          "finite, not negative");
}

PlaceFilter::PlaceFilter(const PlaceGraph& graph, const PlaceFilterOptions& options)
    : options_(Checked(options)),
      positions_in_map_(graph.positions_in_map),
      roads_(graph, options.reach_margin_m),
      belief_(graph.positions_in_map.size()),
      moved_(belief_.size()),
      likelihood_(belief_.size()) {
  Reset();
}

void PlaceFilter::Reset() {
  off_map_ = belief_.empty() ? 1 : kOffMapAtStart;
  std::fill(belief_.begin(), belief_.end(),
            (1 - kOffMapAtStart) / static_cast<double>(belief_.size()));
}

void PlaceFilter::Predict(double dt_s) {
  if (!(dt_s > 0) || !std::isfinite(dt_s)) return Reset();
  if (belief_.empty()) return;
  const double reach_m = options_.max_speed_mps * dt_s + options_.reach_margin_m;
  std::fill(moved_.begin(), moved_.end(), 0.0);
  for (std::uint32_t p = 0; p < belief_.size(); ++p) {
    if (belief_[p] < kLeastMoved) {
      moved_[p] += belief_[p];
      continue;
    }
    const auto weight = [&](const PlaceRoads::Reached& r) {
      return r.distance_m > 0 ? std::exp(-2 * r.distance_m / reach_m) : 1.0;
    };
    const auto reached = roads_.Within(p, reach_m, kMaxReached);
    double total = 0;
    for (const auto& r : reached) total += weight(r);
    for (const auto& r : reached) moved_[r.place_idx] += belief_[p] * weight(r) / total;
  }
  // Shares of a second, over dt_s: anywhere at a constant rate; off and back as a two-state chain.
  const double teleports = 1 - std::pow(1 - options_.teleport_share, dt_s);
  const double crosses = (1 - std::pow(1 - 2 * options_.leave_share, dt_s)) / 2;
  const double anywhere = ((1 - crosses) * teleports * (1 - off_map_) + crosses * off_map_) /
                          static_cast<double>(belief_.size());
  off_map_ = (1 - crosses) * off_map_ + crosses * (1 - off_map_);
  for (std::size_t p = 0; p < belief_.size(); ++p) {
    belief_[p] = (1 - crosses) * (1 - teleports) * moved_[p] + anywhere;
  }
  Normalize();
}

void PlaceFilter::UpdateSimilarity(std::span<const float> similarity) {
  if (similarity.size() != belief_.size()) {
    throw std::invalid_argument(std::to_string(similarity.size()) + " similarities; must be " +
                                std::to_string(belief_.size()) + ", one a panorama");
  }
  if (belief_.size() < 2) return;
  std::vector<double>& scores = likelihood_;
  for (std::size_t p = 0; p < scores.size(); ++p) {
    const double score = similarity[p];
    scores[p] = score > 0 ? std::min(score, 1.0) : 0;  // NaN too is 0
  }
  const auto [least, best] = std::minmax_element(scores.begin(), scores.end());
  if (*least == *best) return;
  const double median = MedianOf(scores);
  std::vector<double>& deviations = moved_;
  for (std::size_t p = 0; p < scores.size(); ++p) deviations[p] = std::abs(scores[p] - median);
  const double spread =
      std::max(kLeastSpread, std::clamp(kMadToSigma * MedianOf(deviations),
                                        kLeastSpreadShare * median, kMostSpreadShare * median));
  // Likelihood over that of a frame off the map: 1 for the best score that chance gives among so
  // many, least for a typical one, most for one twice as far out.
  const double num_places = static_cast<double>(scores.size());
  const double chance_best = kHeavyTail * std::sqrt(2 * std::log(std::max(num_places, 10.0)));
  const double trust = num_places / (num_places + kFewPlaces);
  for (double& score : scores) {
    const double t = std::clamp((score - median) / spread / chance_best - 1, -1.0, 1.0);
    const double log_likelihood =
        t < 0 ? -t * std::log(kLeastLikelihood) : t * std::log(kMostLikelihood);
    score = std::exp(trust * log_likelihood);
  }
  Weigh(options_.off_map_likelihood);
}

void PlaceFilter::UpdateFix(const Eigen::Vector3d& position_in_map, double sigma_m) {
  if (belief_.empty() || !position_in_map.allFinite() || !(sigma_m >= 0) || std::isinf(sigma_m)) {
    return;
  }
  // The vehicle is between panoramas: half a gap beside the fix's own sigma.
  const double spread_m = std::max(std::hypot(sigma_m, options_.reach_margin_m / 2), 1.0);
  // A wrong fix may lie at any panorama, so that it lies at this one is rarer the larger the map.
  const double by_chance = kWrongFixShare / static_cast<double>(belief_.size());
  for (std::size_t p = 0; p < belief_.size(); ++p) {
    const double z = (positions_in_map_[p] - position_in_map).norm() / spread_m;
    likelihood_[p] = (1 - kWrongFixShare) * std::exp(-0.5 * z * z) + by_chance;
  }
  Weigh(by_chance);
}

void PlaceFilter::UpdateNoFix(std::span<const std::uint32_t> searched) {
  std::fill(likelihood_.begin(), likelihood_.end(), 1.0);
  for (const std::uint32_t p : searched) {
    if (p >= belief_.size()) {
      throw std::invalid_argument("searched holds " + std::to_string(p) + "; must be below " +
                                  std::to_string(belief_.size()));
    }
    likelihood_[p] = kSearchedInVain;
  }
  Weigh(1);
}

void PlaceFilter::Weigh(double off_map_likelihood) {
  for (std::size_t p = 0; p < belief_.size(); ++p) belief_[p] *= likelihood_[p];
  off_map_ *= off_map_likelihood;
  Normalize();
}

void PlaceFilter::Normalize() {
  const double total = std::accumulate(belief_.begin(), belief_.end(), off_map_);
  if (!(total > 0) || !std::isfinite(total)) return Reset();
  off_map_ /= total;
  for (double& belief : belief_) belief /= total;
}

std::vector<std::uint32_t> PlaceFilter::Likely(double share, std::size_t most) const {
  std::vector<std::uint32_t> places(belief_.size());
  std::iota(places.begin(), places.end(), 0U);
  const std::size_t count = std::min(most, places.size());
  std::partial_sort(places.begin(), places.begin() + static_cast<std::ptrdiff_t>(count),
                    places.end(), [&](std::uint32_t a, std::uint32_t b) {
                      return belief_[a] != belief_[b] ? belief_[a] > belief_[b] : a < b;
                    });
  const double wanted = share * std::accumulate(belief_.begin(), belief_.end(), 0.0);
  std::size_t num_kept = 0;
  for (double held = 0; num_kept < count && held < wanted; ++num_kept) {
    held += belief_[places[num_kept]];
  }
  places.resize(num_kept);
  return places;
}

double PlaceFilter::BeliefNear(const Eigen::Vector3d& position_in_map, double radius_m) const {
  double near = 0;
  for (std::size_t p = 0; p < belief_.size(); ++p) {
    if ((positions_in_map_[p] - position_in_map).norm() <= radius_m) near += belief_[p];
  }
  return near;
}

}  // namespace panofix
