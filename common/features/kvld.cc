#include "common/features/kvld.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <stdexcept>
#include <tuple>

#include "common/base/log.h"
#include "common/features/kvld_selection.h"
#include "common/features/match_neighbours.h"
#include "common/features/virtual_line.h"

namespace panofix {
namespace {

constexpr int kMaxRateHalvings = 5;

void CheckRange(const char* name, double value, double low, double high) {
  if (!(value >= low && value <= high)) {
    throw std::invalid_argument(Format("%s = %g; must lie in [%g, %g]", name, value, low, high));
  }
}

void CheckIndex(const char* which, int idx, std::size_t count) {
  if (idx < 0 || static_cast<std::size_t>(idx) >= count) {
    throw std::invalid_argument(
        Format("a match names %s keypoint %d of %zu; must exist", which, idx, count));
  }
}

bool IsFinite(const Keypoint& k) {
  return std::isfinite(k.x_px) && std::isfinite(k.y_px) && std::isfinite(k.size_px) &&
         std::isfinite(k.angle_deg);
}

PlacedMatch Place(const Keypoint& query, const Keypoint& database, const FeatureMatch& match) {
  const bool has_sizes = query.size_px > 0 && database.size_px > 0;
  const double scale = has_sizes ? double{database.size_px} / query.size_px : 1;
  const double turn_rad = (double{database.angle_deg} - query.angle_deg) * std::numbers::pi / 180;
  return {{query.x_px, query.y_px},
          {database.x_px, database.y_px},
          std::polar(scale, turn_rad),
          match.query_idx,
          match.database_idx};
}

// Distinct matches of finite keypoints by their indices, whatever order they came in.
std::vector<int> UsableInOrder(std::span<const Keypoint> query, std::span<const Keypoint> database,
                               std::span<const FeatureMatch> matches) {
  const auto pair_of = [&](int i) {
    const FeatureMatch& m = matches[static_cast<std::size_t>(i)];
    return std::pair(m.query_idx, m.database_idx);
  };
  std::vector<int> order;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    CheckIndex("query", matches[i].query_idx, query.size());
    CheckIndex("database", matches[i].database_idx, database.size());
    if (IsFinite(query[static_cast<std::size_t>(matches[i].query_idx)]) &&
        IsFinite(database[static_cast<std::size_t>(matches[i].database_idx)])) {
      order.push_back(static_cast<int>(i));
    }
  }
  std::sort(order.begin(), order.end(),
            [&](int a, int b) { return std::tuple(pair_of(a), a) < std::tuple(pair_of(b), b); });
  const auto is_repeat = [&](int a, int b) { return pair_of(a) == pair_of(b); };
  order.erase(std::unique(order.begin(), order.end(), is_repeat), order.end());
  return order;
}

}  // namespace

void KvldOptions::Check() const {
  constexpr double kAny = std::numeric_limits<double>::max();
  CheckRange("min_connected", min_connected, 1, std::numeric_limits<int>::max());
  CheckRange("num_samples", num_samples, 1, kMaxLineSamples);
  CheckRange("num_sub_bins", num_sub_bins, 2, kMaxLineSubBins);
  CheckRange("num_orientation_bins", num_orientation_bins, 2, kMaxLineOrientationBins);
  if (num_orientation_bins % (2 * num_sub_bins) != num_sub_bins || num_orientation_bins % 2 != 0) {
    throw std::invalid_argument(
        Format("num_orientation_bins = %d; must be even and an odd multiple of num_sub_bins = %d",
               num_orientation_bins, num_sub_bins));
  }
  CheckRange("contrast_weight", contrast_weight, 0, kAny);
  CheckRange("orientation_weight", orientation_weight, 0, kAny);
  CheckRange("min_distance_px", min_distance_px, 0, kAny);
  CheckRange("max_contrast", max_contrast, 0, kAny);
  CheckRange("inlier_rate", inlier_rate, std::numeric_limits<double>::min(), 1);
  CheckRange("distance_threshold", distance_threshold, 0, kAny);
  CheckRange("descriptor_threshold", descriptor_threshold, 0, kAny);
}

std::vector<int> FilterKvld(const GradientPyramid& query_image, std::span<const Keypoint> query,
                            const GradientPyramid& database_image,
                            std::span<const Keypoint> database,
                            std::span<const FeatureMatch> matches, const KvldOptions& options) {
  options.Check();
  const std::vector<int> order = UsableInOrder(query, database, matches);
  std::vector<PlacedMatch> placed;
  placed.reserve(order.size());
  for (const int i : order) {
    const FeatureMatch& m = matches[static_cast<std::size_t>(i)];
    placed.push_back(Place(query[static_cast<std::size_t>(m.query_idx)],
                           database[static_cast<std::size_t>(m.database_idx)], m));
  }
  KvldSelection selection(query_image, query.size(), database_image, database.size(), placed,
                          options);
  std::vector<int> kept;
  double inlier_rate = options.inlier_rate;
  for (int halvings = 0; halvings <= kMaxRateHalvings; ++halvings, inlier_rate /= 2) {
    const std::vector<char> is_kept = selection.Run(inlier_rate);
    kept.clear();
    for (std::size_t i = 0; i < order.size(); ++i) {
      if (is_kept[i] != 0) kept.push_back(order[i]);
    }
    if (static_cast<double>(kept.size()) >= inlier_rate * static_cast<double>(order.size())) break;
  }
  std::sort(kept.begin(), kept.end());
  return kept;
}

}  // namespace panofix
