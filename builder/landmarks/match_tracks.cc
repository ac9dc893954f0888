#include "builder/landmarks/match_tracks.h"

#include <tbb/parallel_for.h>

#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <set>

#include "common/features/matcher.h"

namespace panofix {
namespace {

constexpr double kMaxNeighbourDistance_m = 35;
constexpr std::size_t kMaxNeighbours = 10;
constexpr float kMaxRangeSigma_m = 0.4F;  // three of it: 1.2 m along a ray
constexpr float kMaxSizeRatio = 1.5F;
constexpr double kMaxAngle_deg = 20;
constexpr int kMaxDistanceSq = 250 * 250;
constexpr double kMaxRatioSq = 0.85 * 0.85;  // of best to best elsewhere
constexpr float kElsewhere = 0.5F;           // times the size: another place, not another look

// A panorama's landmarks by bearing and size. Levels are innermost, so that three neighbouring ones
// are one run of entries.
class BearingGrid {
 public:
  BearingGrid(const Rigid3& local_from_pano, std::vector<PlacedLandmark> placed)
      : pano_from_local_(local_from_pano.Inverse()), placed_(std::move(placed)) {
    std::vector<std::uint32_t> bin_of(placed_.size());
    starts_.assign(kRows * kColumns * kLevels + 1, 0);
    for (std::size_t i = 0; i < placed_.size(); ++i) {
      const Eigen::Vector3d x = pano_from_local_ * placed_[i].point_in_local.cast<double>();
      bin_of[i] = Bin(RowOf(x), ColumnOf(x), LevelOf(placed_[i].size_m));
      ++starts_[bin_of[i] + 1];
    }
    for (std::size_t b = 1; b < starts_.size(); ++b) starts_[b] += starts_[b - 1];
    std::vector<std::uint32_t> fill(starts_.begin(), starts_.end() - 1);
    entries_.resize(placed_.size());
    for (std::uint32_t i = 0; i < placed_.size(); ++i) entries_[fill[bin_of[i]]++] = i;
  }

  [[nodiscard]] const std::vector<PlacedLandmark>& placed() const { return placed_; }

  // Calls visit(index) for landmarks that may lie within the reach of `a` as seen from here.
  template <typename Visit>
  void ForCandidates(const PlacedLandmark& a, const Visit& visit) const {
    const Eigen::Vector3d x = pano_from_local_ * a.point_in_local.cast<double>();
    const double range_m = x.norm();
    if (!(range_m > kNearest_m)) return;
    // Across the sight from here: all of the other errors, and what of a's ray is across.
    const Eigen::Vector3d ray = pano_from_local_.rotation * a.ray_in_local.cast<double>();
    const double across_m = double{a.range_sigma_m} * ray.cross(x / range_m).norm();
    const double reach_m = std::sqrt(double{kMaxDeviationSq}) *
                           std::hypot(across_m, kOtherReach * double{a.other_sigma_m});
    const double angle_rad = std::atan2(reach_m, std::max(0.7 * range_m, range_m - reach_m));
    const int rows = static_cast<int>(angle_rad / kBin_rad) + 1;
    const int row = RowOf(x), column = ColumnOf(x), level = LevelOf(a.size_m);
    for (int r = std::max(0, row - rows); r <= std::min(kRows - 1, row + rows); ++r) {
      const double elevation = (r + 0.5) * kBin_rad - std::numbers::pi / 2;
      const double widened = angle_rad / std::max(0.05, std::cos(elevation));
      const int columns = std::min(kColumns / 2 - 1, static_cast<int>(widened / kBin_rad) + 1);
      for (int c = column - columns; c <= column + columns; ++c) {
        const int wrapped = (c + kColumns) % kColumns;
        const std::uint32_t begin = starts_[Bin(r, wrapped, std::max(0, level - 1))];
        const std::uint32_t end = starts_[Bin(r, wrapped, std::min(kLevels - 1, level + 1)) + 1];
        for (std::uint32_t k = begin; k < end; ++k) visit(entries_[k]);
      }
    }
  }

 private:
  static constexpr int kRows = 72, kColumns = 144, kLevels = 16;
  static constexpr double kBin_rad = std::numbers::pi / kRows;
  static constexpr double kNearest_m = 0.5;
  static constexpr double kOtherReach = 1.5;  // the other landmark adds to it

  static std::uint32_t Bin(int row, int column, int level) {
    return static_cast<std::uint32_t>((row * kColumns + column) * kLevels + level);
  }
  static int RowOf(const Eigen::Vector3d& x) {
    const double elevation = std::atan2(x.z(), std::hypot(x.x(), x.y()));
    return std::clamp(static_cast<int>((elevation + std::numbers::pi / 2) / kBin_rad), 0,
                      kRows - 1);
  }
  static int ColumnOf(const Eigen::Vector3d& x) {
    const double azimuth = std::atan2(x.x(), x.y()) + std::numbers::pi;
    return std::clamp(static_cast<int>(azimuth / kBin_rad), 0, kColumns - 1);
  }
  static int LevelOf(float size_m) {
    constexpr double kSmallest_m = 0.03;
    const double level = std::log(double{size_m} / kSmallest_m) / std::log(double{kMaxSizeRatio});
    return std::clamp(static_cast<int>(std::floor(level)), 0, kLevels - 1);
  }

  const Rigid3 pano_from_local_;
  std::vector<PlacedLandmark> placed_;
  std::vector<std::uint32_t> starts_, entries_;
};

// Best candidate of a landmark, and the best that lies somewhere else.
struct BestTwo {
  std::uint32_t best = std::numeric_limits<std::uint32_t>::max();
  int best_sq = std::numeric_limits<int>::max(), elsewhere_sq = std::numeric_limits<int>::max();

  void Offer(std::uint32_t idx, int sq, const std::vector<PlacedLandmark>& placed) {
    const auto is_elsewhere = [&](std::uint32_t other) {
      const float limit_m = kElsewhere * std::max(placed[idx].size_m, placed[other].size_m);
      return (placed[idx].point_in_local - placed[other].point_in_local).norm() > limit_m;
    };
    const bool is_first = best >= placed.size();
    if (sq < best_sq) {
      if (!is_first && is_elsewhere(best)) elsewhere_sq = best_sq;
      best = idx, best_sq = sq;
    } else if (!is_first && is_elsewhere(best)) {
      elsewhere_sq = std::min(elsewhere_sq, sq);
    }
  }
  [[nodiscard]] bool IsClear() const {
    return best_sq <= kMaxDistanceSq && best_sq < kMaxRatioSq * elsewhere_sq;
  }
};

Eigen::Vector3f Median(std::vector<Eigen::Vector3f> values) {
  Eigen::Vector3f median;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  for (int k = 0; k < 3; ++k) {
    std::nth_element(values.begin(), middle, values.end(),
                     [k](const auto& a, const auto& b) { return a[k] < b[k]; });
    median[k] = (*middle)[k];
  }
  return median;
}

// Planes err as a whole: matches of one plane pair whose offset is unlike the pair's median are
// wrong.
void VoteByPlanes(const BearingGrid& a, const BearingGrid& b, std::vector<TrackMatch>* matches) {
  constexpr std::size_t kFewestVoters = 5;
  constexpr float kSpread_m = 0.3F;  // tilts and relief differ along a plane
  std::map<std::pair<int, int>, std::vector<Eigen::Vector3f>> offsets;
  const auto surfaces = [&](const TrackMatch& m) {
    return std::pair<int, int>(a.placed()[m.a.idx].surface_idx, b.placed()[m.b.idx].surface_idx);
  };
  const auto offset = [&](const TrackMatch& m) {
    return Eigen::Vector3f(a.placed()[m.a.idx].point_in_local - b.placed()[m.b.idx].point_in_local);
  };
  for (const TrackMatch& m : *matches) offsets[surfaces(m)].push_back(offset(m));
  std::map<std::pair<int, int>, Eigen::Vector3f> medians;
  for (auto& [pair, values] : offsets) {
    const bool is_raster = pair.first == 0 || pair.second == 0;
    if (!is_raster && values.size() >= kFewestVoters) medians[pair] = Median(std::move(values));
  }
  std::erase_if(*matches, [&](const TrackMatch& m) {
    const auto median = medians.find(surfaces(m));
    if (median == medians.end()) return false;
    const float pixels_m =
        2 * std::max(a.placed()[m.a.idx].other_sigma_m, b.placed()[m.b.idx].other_sigma_m);
    return (offset(m) - median->second).norm() > kSpread_m + pixels_m;
  });
}

std::vector<TrackMatch> MatchPair(const MergedLandmarks& merged, const BearingGrid& a,
                                  const BearingGrid& b, std::uint32_t pano_a,
                                  std::uint32_t pano_b) {
  std::vector<BestTwo> best_of_a(a.placed().size()), best_of_b(b.placed().size());
  for (std::uint32_t i = 0; i < a.placed().size(); ++i) {
    const PlacedLandmark& one = a.placed()[i];
    const std::uint8_t* descriptor = merged[pano_a][i].landmark.descriptor.data();
    b.ForCandidates(one, [&](std::uint32_t j) {
      const PlacedLandmark& other = b.placed()[j];
      if (!AlikeInShape(one, other) || DeviationSq(one, other) > kMaxDeviationSq) return;
      const int sq = DescriptorDistanceSq(descriptor, merged[pano_b][j].landmark.descriptor.data());
      best_of_a[i].Offer(j, sq, b.placed());
      best_of_b[j].Offer(i, sq, a.placed());
    });
  }
  std::vector<TrackMatch> matches;
  for (std::uint32_t i = 0; i < best_of_a.size(); ++i) {
    const BestTwo& best = best_of_a[i];
    if (!best.IsClear() || best_of_b[best.best].best != i || !best_of_b[best.best].IsClear())
      continue;
    matches.push_back({{pano_a, i}, {pano_b, best.best}, best.best_sq});
  }
  VoteByPlanes(a, b, &matches);
  return matches;
}

}  // namespace

PlacedLandmark Place(const LayerInput& input, const Landmark& landmark) {
  const Rigid3& local_from_pano = input.panoramas[landmark.panorama].local_from_pano;
  const Eigen::Vector3d point = landmark.point_in_pano.cast<double>();
  PlacedLandmark placed;
  placed.point_in_local = (local_from_pano * point).cast<float>();
  placed.ray_in_local = (local_from_pano.rotation * point.normalized()).cast<float>();
  placed.range_m = static_cast<float>(point.norm());
  placed.range_sigma_m = std::min(kMaxRangeSigma_m, landmark.range_sigma_m);
  const double heading_m = input.errors.panorama_heading_sigma_deg * kRadPerDeg * point.norm();
  const double geotag_m = std::hypot(input.errors.panorama_position_sigma_m, heading_m);
  placed.other_sigma_m = static_cast<float>(std::hypot(geotag_m, double{landmark.point_sigma_m}));
  placed.size_m = landmark.size_m;
  placed.angle_deg = landmark.angle_deg;
  placed.surface_idx = landmark.surface_idx;
  return placed;
}

bool AlikeInShape(const PlacedLandmark& a, const PlacedLandmark& b) {
  return std::max(a.size_m, b.size_m) < kMaxSizeRatio * std::min(a.size_m, b.size_m) &&
         AngleDifference_deg(double{a.angle_deg}, double{b.angle_deg}) < kMaxAngle_deg;
}

float DeviationSq(const PlacedLandmark& a, const PlacedLandmark& b) {
  const Eigen::Vector3f d = a.point_in_local - b.point_in_local;
  const float other_sq = a.other_sigma_m * a.other_sigma_m + b.other_sigma_m * b.other_sigma_m;
  const float a_sq = a.range_sigma_m * a.range_sigma_m, b_sq = b.range_sigma_m * b.range_sigma_m;
  if (d.squaredNorm() > kMaxDeviationSq * (other_sq + a_sq + b_sq)) return 2 * kMaxDeviationSq;
  const Eigen::Matrix3f covariance = other_sq * Eigen::Matrix3f::Identity() +
                                     a_sq * a.ray_in_local * a.ray_in_local.transpose() +
                                     b_sq * b.ray_in_local * b.ray_in_local.transpose();
  return d.dot(covariance.inverse() * d);
}

std::vector<std::pair<std::uint32_t, std::uint32_t>> NeighbourPairs(
    const LayerInput& input, const std::vector<bool>& is_excluded) {
  const auto n = static_cast<std::uint32_t>(input.panoramas.size());
  std::set<std::pair<std::uint32_t, std::uint32_t>> pairs;
  for (std::uint32_t a = 0; a < n; ++a) {
    if (is_excluded[a]) continue;
    std::vector<std::pair<double, std::uint32_t>> near;
    for (std::uint32_t b = 0; b < n; ++b) {
      const double distance_m = (input.panoramas[a].local_from_pano.translation -
                                 input.panoramas[b].local_from_pano.translation)
                                    .norm();
      const bool both_fixed = input.panoramas[a].is_fixed && input.panoramas[b].is_fixed;
      if (a == b || is_excluded[b] || both_fixed || !(distance_m < kMaxNeighbourDistance_m))
        continue;
      near.emplace_back(distance_m, b);
    }
    std::sort(near.begin(), near.end());
    for (std::size_t k = 0; k < std::min(kMaxNeighbours, near.size()); ++k) {
      pairs.insert(std::minmax(a, near[k].second));
    }
  }
  return {pairs.begin(), pairs.end()};
}

std::vector<TrackMatch> MatchLandmarks(const LayerInput& input, const MergedLandmarks& merged,
                                       const std::vector<bool>& is_excluded) {
  std::vector<std::unique_ptr<BearingGrid>> grids(merged.size());
  tbb::parallel_for(std::size_t{0}, merged.size(), [&](std::size_t p) {
    std::vector<PlacedLandmark> placed;
    placed.reserve(merged[p].size());
    for (const MergedLandmark& m : merged[p]) placed.push_back(Place(input, m.landmark));
    grids[p] = std::make_unique<BearingGrid>(input.panoramas[p].local_from_pano, std::move(placed));
  });
  const auto pairs = NeighbourPairs(input, is_excluded);
  std::vector<std::vector<TrackMatch>> of_pair(pairs.size());
  tbb::parallel_for(std::size_t{0}, pairs.size(), [&](std::size_t k) {
    const auto [a, b] = pairs[k];
    of_pair[k] = MatchPair(merged, *grids[a], *grids[b], a, b);
  });
  std::vector<TrackMatch> matches;
  for (const auto& some : of_pair) matches.insert(matches.end(), some.begin(), some.end());
  return matches;
}

}  // namespace panofix
