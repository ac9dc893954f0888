#include "builder/landmarks/geotag_check.h"

#include <tbb/parallel_for.h>

#include <cmath>
#include <optional>
#include <tuple>

#include "builder/landmarks/match_tracks.h"
#include "common/base/log.h"
#include "common/base/rng.h"
#include "common/features/matcher.h"

namespace panofix {
namespace {

constexpr std::size_t kNumStrongest = 1000;  // landmarks a panorama; brute force over pairs
constexpr int kFewestInliers = 12;
constexpr int kNumSamples = 300;
constexpr float kInlier_m = 0.6F;  // plane errors at common ranges, twice
constexpr float kLeastBaseline_m = 2;
constexpr std::size_t kFewestWitnesses = 2;  // neighbours that ask for the same shift
constexpr double kSameShift_m = 1.5;

struct PointPair {
  Eigen::Vector3f a, b;  // local by the geotags
  bool agrees = false;   // with them
};

// Landmarks that most views show: those of textures that last.
std::vector<std::uint32_t> Strongest(const std::vector<MergedLandmark>& merged) {
  std::vector<std::uint32_t> order(merged.size());
  for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = i;
  const auto key = [&](std::uint32_t i) {
    return std::make_tuple(-static_cast<int>(merged[i].landmark.views.size()), -merged[i].response,
                           i);
  };
  const std::size_t n = std::min(kNumStrongest, order.size());
  std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(n), order.end(),
                    [&](std::uint32_t a, std::uint32_t b) { return key(a) < key(b); });
  order.resize(n);
  return order;
}

struct StrongSet {
  std::vector<PlacedLandmark> placed;
  std::vector<std::uint8_t> descriptors;
};

StrongSet MakeStrongSet(const LayerInput& input, const std::vector<MergedLandmark>& merged) {
  StrongSet set;
  for (const std::uint32_t i : Strongest(merged)) {
    const Landmark& landmark = merged[i].landmark;
    set.placed.push_back(Place(input, landmark));
    set.descriptors.insert(set.descriptors.end(), landmark.descriptor.begin(),
                           landmark.descriptor.end());
  }
  return set;
}

std::vector<PointPair> MatchByLooks(const StrongSet& a, const StrongSet& b) {
  std::vector<PointPair> pairs;
  for (const FeatureMatch& m : MatchDescriptors(a.descriptors, b.descriptors, {})) {
    const PlacedLandmark& one = a.placed[static_cast<std::size_t>(m.query_idx)];
    const PlacedLandmark& other = b.placed[static_cast<std::size_t>(m.database_idx)];
    if (!AlikeInShape(one, other)) continue;
    pairs.push_back(
        {one.point_in_local, other.point_in_local, DeviationSq(one, other) <= kMaxDeviationSq});
  }
  return pairs;
}

// Turn about the vertical and shift that bring b's points onto a's.
struct Alignment {
  Eigen::Matrix3f rotation;
  Eigen::Vector3f shift;
  float turn_rad = 0;
};

std::optional<Alignment> Align(const PointPair& p, const PointPair& q) {
  const Eigen::Vector3f in_a = q.a - p.a, in_b = q.b - p.b;
  const float length_a = in_a.head<2>().norm(), length_b = in_b.head<2>().norm();
  if (length_a < kLeastBaseline_m || std::abs(length_a - length_b) > 2 * kInlier_m)
    return std::nullopt;
  Alignment alignment;
  alignment.turn_rad =
      std::remainder(std::atan2(in_a.y(), in_a.x()) - std::atan2(in_b.y(), in_b.x()),
                     2 * std::numbers::pi_v<float>);
  alignment.rotation =
      Eigen::AngleAxisf(alignment.turn_rad, Eigen::Vector3f::UnitZ()).toRotationMatrix();
  alignment.shift = 0.5F * (p.a + q.a) - alignment.rotation * (0.5F * (p.b + q.b));
  return alignment;
}

// How two panoramas get along: the weight of evidence and the shift of b that would mend it.
struct Verdict {
  bool is_good = false, is_bad = false;
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();  // metres, local
};

Verdict Judge(const LayerInput& input, std::uint32_t a, std::uint32_t b,
              const std::vector<PointPair>& pairs) {
  Verdict verdict;
  const auto num_agree = static_cast<int>(
      std::count_if(pairs.begin(), pairs.end(), [](const PointPair& p) { return p.agrees; }));
  verdict.is_good = num_agree >= kFewestInliers;
  if (static_cast<int>(pairs.size()) < std::max(kFewestInliers, 2 * num_agree)) return verdict;
  const Eigen::Vector3f centre = input.panoramas[b].local_from_pano.translation.cast<float>();
  Rng rng(1, Format("landmarks/geotag/%u-%u", a, b));
  int best = 2 * num_agree;
  for (int k = 0; k < kNumSamples; ++k) {
    const PointPair& p = pairs[rng.Below(pairs.size())];
    const PointPair& q = pairs[rng.Below(pairs.size())];
    const std::optional<Alignment> alignment = Align(p, q);
    if (!alignment) continue;
    const Eigen::Vector3f shift = alignment->rotation * centre + alignment->shift - centre;
    const double shift_m = double{shift.norm()};
    const double turn_deg = std::abs(double{alignment->turn_rad}) / kRadPerDeg;
    if (shift_m < input.options.max_shift_m && turn_deg < input.options.max_turn_deg) continue;
    const auto num_inliers =
        static_cast<int>(std::count_if(pairs.begin(), pairs.end(), [&](const PointPair& r) {
          return (alignment->rotation * r.b + alignment->shift - r.a).norm() < kInlier_m;
        }));
    if (num_inliers < kFewestInliers || num_inliers <= best) continue;
    best = num_inliers;
    verdict.is_bad = true, verdict.is_good = false;
    verdict.shift = shift.cast<double>();
  }
  return verdict;
}

struct JudgedPair {
  std::uint32_t a, b;
  Verdict verdict;
};

// The shift that would mend a panorama with all that it gets along badly with, or none. Repeated
// façades disagree too, but each neighbour then asks for another shift.
std::optional<Eigen::Vector3d> CommonShift(std::uint32_t panorama,
                                           const std::vector<JudgedPair>& judged) {
  std::vector<Eigen::Vector3d> shifts;
  for (const JudgedPair& pair : judged) {
    if (!pair.verdict.is_bad || (pair.a != panorama && pair.b != panorama)) continue;
    shifts.push_back(pair.b == panorama ? pair.verdict.shift
                                        : Eigen::Vector3d(-pair.verdict.shift));
  }
  if (shifts.size() < kFewestWitnesses) return std::nullopt;
  for (const Eigen::Vector3d& shift : shifts) {
    if ((shift - shifts.front()).norm() > kSameShift_m) return std::nullopt;
  }
  return shifts.front();
}

// Blames those with the most disagreements beyond agreements, until none is left.
std::vector<double> Blame(const LayerInput& input, std::vector<JudgedPair> judged) {
  std::vector<double> fault_m(input.panoramas.size(), 0.0);
  for (;;) {
    std::vector<int> score(fault_m.size(), 0);
    for (const JudgedPair& pair : judged) {
      for (const std::uint32_t p : {pair.a, pair.b})
        score[p] += int{pair.verdict.is_bad} - int{pair.verdict.is_good};
    }
    int most = 0;
    std::vector<double> shift_m(fault_m.size(), 0.0);
    for (std::uint32_t p = 0; p < score.size(); ++p) {
      if (score[p] <= 0 || input.panoramas[p].is_fixed) continue;
      const auto shift = CommonShift(p, judged);
      if (!shift) continue;
      shift_m[p] = shift->norm();
      most = std::max(most, score[p]);
    }
    if (most == 0) return fault_m;
    for (std::uint32_t p = 0; p < score.size(); ++p) {
      if (score[p] == most && shift_m[p] > 0) fault_m[p] = shift_m[p];
    }
    std::erase_if(
        judged, [&](const JudgedPair& pair) { return fault_m[pair.a] > 0 || fault_m[pair.b] > 0; });
  }
}

}  // namespace

std::vector<double> FindGeotagFaults(const LayerInput& input, const MergedLandmarks& merged) {
  const std::vector<bool> none(merged.size(), false);
  const auto pairs = NeighbourPairs(input, none);
  std::vector<StrongSet> strong(merged.size());
  tbb::parallel_for(std::size_t{0}, merged.size(),
                    [&](std::size_t p) { strong[p] = MakeStrongSet(input, merged[p]); });
  std::vector<JudgedPair> judged(pairs.size());
  tbb::parallel_for(std::size_t{0}, pairs.size(), [&](std::size_t k) {
    const auto [a, b] = pairs[k];
    judged[k] = {a, b, Judge(input, a, b, MatchByLooks(strong[a], strong[b]))};
  });
  return Blame(input, std::move(judged));
}

}  // namespace panofix
