#include "builder/landmarks/merge_observations.h"

#include <tbb/parallel_for.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "common/base/log.h"
#include "common/features/matcher.h"

namespace panofix {
namespace {

constexpr double kMaxShiftShare = 0.25;  // of the size: keypoints scatter by half of it
constexpr double kMaxSizeRatio = 1.4;
constexpr double kMaxAngle_deg = 20;
constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

// What no street holds is a fault upstream; it would also overflow the cells below.
constexpr float kMaxRange_m = 1e4F, kLeastSize_m = 1e-4F, kMaxSize_m = 1e3F;

bool IsUsable(const LandmarkObservation& o) {
  const float range_m = o.point_in_pano.norm();
  return o.point_in_pano.allFinite() && range_m > 0 && range_m < kMaxRange_m &&
         o.range_sigma_m > 0 && std::isfinite(o.range_sigma_m) && o.size_m > kLeastSize_m &&
         o.size_m < kMaxSize_m && std::isfinite(o.angle_deg) && std::isfinite(o.response);
}

// A total order on contents: what compares equal is equal.
bool Precedes(const LandmarkObservation& a, const LandmarkObservation& b) {
  const auto key = [](const LandmarkObservation& o) {
    return std::make_tuple(o.view, -o.response, o.surface_idx, o.point_in_pano.x(),
                           o.point_in_pano.y(), o.point_in_pano.z(), o.size_m, o.angle_deg,
                           o.range_sigma_m);
  };
  const auto a_key = key(a), b_key = key(b);
  if (a_key != b_key) return a_key < b_key;
  return std::memcmp(a.descriptor.data(), b.descriptor.data(), kDescriptorSize) < 0;
}

Landmark FromObservation(const LandmarkObservation& o, double focal_px) {
  Landmark landmark;
  landmark.panorama = o.panorama;
  landmark.point_in_pano = o.point_in_pano;
  landmark.range_sigma_m = o.range_sigma_m;
  landmark.point_sigma_m = static_cast<float>(
      KeypointSigma_m(double{o.size_m}, double{o.point_in_pano.norm()}, focal_px));
  landmark.surface_idx = o.surface_idx;
  landmark.size_m = o.size_m;
  landmark.angle_deg = o.angle_deg;
  std::copy(o.descriptor.begin(), o.descriptor.end(), landmark.descriptor.begin());
  landmark.views = {o.view};
  return landmark;
}

// A cluster that grows around its first observation, the leader.
struct Cluster {
  std::vector<const LandmarkObservation*> members;
  std::array<std::uint8_t, kDescriptorSize> mean;
  std::uint32_t next = kNone;  // in its bucket
};

// Clusters of one panorama, found by place and size. Buckets hold chains; what shares a bucket by
// chance is told apart by its distance.
class ClusterIndex {
 public:
  ClusterIndex(std::size_t num_expected, double max_descriptor_distance)
      : max_distance_sq_(max_descriptor_distance * max_descriptor_distance) {
    std::size_t num_buckets = 64;
    while (num_buckets < 2 * num_expected) num_buckets *= 2;
    heads_.assign(num_buckets, kNone);
  }

  void Add(const LandmarkObservation& o) {
    const std::uint32_t best = FindBest(o);
    if (best != kNone) return Join(o, &clusters_[best]);
    Cluster cluster;
    cluster.members = {&o};
    std::copy(o.descriptor.begin(), o.descriptor.end(), cluster.mean.begin());
    const int level = Level(o.size_m);
    std::uint32_t& head = heads_[Bucket(o.surface_idx, level, CellOf(o.point_in_pano, level))];
    cluster.next = std::exchange(head, static_cast<std::uint32_t>(clusters_.size()));
    clusters_.push_back(std::move(cluster));
  }

  [[nodiscard]] const std::vector<Cluster>& clusters() const { return clusters_; }

 private:
  // Sizes by half octaves: what is alike in size is at most one level apart.
  static int Level(float size_m) {
    return static_cast<int>(std::floor(2 * std::log2(double{size_m})));
  }
  static double CellEdge_m(int level) { return 2 * kMaxShiftShare * std::exp2((level + 1) * 0.5); }
  static Eigen::Array3i CellOf(const Eigen::Vector3f& point, int level) {
    return (point.cast<double>().array() / CellEdge_m(level)).floor().cast<int>();
  }
  [[nodiscard]] std::size_t Bucket(int surface, int level, const Eigen::Array3i& cell) const {
    std::uint64_t h = 0x9E3779B97F4A7C15ULL;
    for (const int part : {surface, level, cell.x(), cell.y(), cell.z()}) {
      h = (h ^ static_cast<std::uint32_t>(part)) * 0xD6E8FEB86659FD93ULL;
      h ^= h >> 32;
    }
    return h & (heads_.size() - 1);
  }

  [[nodiscard]] std::uint32_t FindBest(const LandmarkObservation& o) const {
    std::uint32_t best = kNone;
    int best_sq = std::numeric_limits<int>::max();
    const auto reach = static_cast<float>(kMaxShiftShare * double{o.size_m});
    const int level = Level(o.size_m);
    for (int l = level - 1; l <= level + 1; ++l) {
      const Eigen::Array3i low = CellOf(o.point_in_pano - Eigen::Vector3f::Constant(reach), l);
      const Eigen::Array3i high = CellOf(o.point_in_pano + Eigen::Vector3f::Constant(reach), l);
      Eigen::Array3i cell;
      for (cell.x() = low.x(); cell.x() <= high.x(); ++cell.x()) {
        for (cell.y() = low.y(); cell.y() <= high.y(); ++cell.y()) {
          for (cell.z() = low.z(); cell.z() <= high.z(); ++cell.z()) {
            SearchBucket(o, Bucket(o.surface_idx, l, cell), &best, &best_sq);
          }
        }
      }
    }
    return best;
  }

  void SearchBucket(const LandmarkObservation& o, std::size_t bucket, std::uint32_t* best,
                    int* best_sq) const {
    for (std::uint32_t i = heads_[bucket]; i != kNone; i = clusters_[i].next) {
      const LandmarkObservation& leader = *clusters_[i].members.front();
      if (!Alike(o, leader)) continue;
      const int sq = DescriptorDistanceSq(o.descriptor.data(), clusters_[i].mean.data());
      if (sq > max_distance_sq_ || std::tie(sq, i) >= std::tie(*best_sq, *best)) continue;
      *best_sq = sq, *best = i;
    }
  }

  static bool Alike(const LandmarkObservation& a, const LandmarkObservation& b) {
    const double smaller = double{std::min(a.size_m, b.size_m)};
    return a.surface_idx == b.surface_idx &&
           double{std::max(a.size_m, b.size_m)} < kMaxSizeRatio * smaller &&
           double{(a.point_in_pano - b.point_in_pano).norm()} < kMaxShiftShare * smaller &&
           AngleDifference_deg(double{a.angle_deg}, double{b.angle_deg}) < kMaxAngle_deg;
  }

  static void Join(const LandmarkObservation& o, Cluster* cluster) {
    cluster->members.push_back(&o);
    constexpr std::size_t kEnough = 16;  // more do not move the mean that others are compared with
    if (cluster->members.size() > kEnough) return;
    std::vector<const std::uint8_t*> parts;
    for (const auto* member : cluster->members) parts.push_back(member->descriptor.data());
    cluster->mean = MeanDescriptor(parts);
  }

  const double max_distance_sq_;
  std::vector<std::uint32_t> heads_;
  std::vector<Cluster> clusters_;
};

MergedLandmark Summarize(const Cluster& cluster, double focal_px) {
  const auto& members = cluster.members;
  MergedLandmark merged{FromObservation(*members.front(), focal_px), members.front()->response};
  if (members.size() == 1) return merged;
  Eigen::Vector3d point = Eigen::Vector3d::Zero();
  double log_size = 0, sigma_m = 0, turn_deg = 0;
  std::vector<const std::uint8_t*> descriptors;
  Landmark& landmark = merged.landmark;
  landmark.views.clear();
  for (const LandmarkObservation* o : members) {
    point += o->point_in_pano.cast<double>();
    log_size += std::log(double{o->size_m});
    sigma_m += double{o->range_sigma_m};
    turn_deg += std::remainder(double{o->angle_deg} - double{members.front()->angle_deg}, 360.0);
    descriptors.push_back(o->descriptor.data());
    landmark.views.push_back(o->view);
    merged.response = std::max(merged.response, o->response);
  }
  const double share = 1.0 / static_cast<double>(members.size());
  landmark.point_in_pano = (share * point).cast<float>();
  landmark.range_sigma_m = static_cast<float>(share * sigma_m);
  landmark.size_m = static_cast<float>(std::exp(share * log_size));
  const double angle_deg = double{members.front()->angle_deg} + share * turn_deg;
  landmark.angle_deg = static_cast<float>(angle_deg - 360 * std::floor(angle_deg / 360));
  landmark.point_sigma_m = static_cast<float>(
      KeypointSigma_m(double{landmark.size_m}, double{landmark.point_in_pano.norm()}, focal_px));
  landmark.descriptor = MeanDescriptor(descriptors);
  // Ascending already: views come first in the order.
  landmark.views.erase(std::unique(landmark.views.begin(), landmark.views.end()),
                       landmark.views.end());
  return merged;
}

std::vector<MergedLandmark> MergeOne(const LayerInput& input,
                                     std::vector<const LandmarkObservation*> observations) {
  std::sort(observations.begin(), observations.end(),
            [](const auto* a, const auto* b) { return Precedes(*a, *b); });
  std::vector<MergedLandmark> merged;
  if (!input.options.merge) {
    for (const auto* o : observations) {
      merged.push_back({FromObservation(*o, input.focal_px), o->response});
    }
    return merged;
  }
  ClusterIndex index(observations.size(), input.options.max_merge_descriptor_distance);
  for (const auto* o : observations) index.Add(*o);
  merged.reserve(index.clusters().size());
  for (const Cluster& cluster : index.clusters()) {
    merged.push_back(Summarize(cluster, input.focal_px));
  }
  return merged;
}

}  // namespace

std::array<std::uint8_t, kDescriptorSize> MeanDescriptor(
    std::span<const std::uint8_t* const> descriptors) {
  std::array<int, kDescriptorSize> sum{};
  double length = 0;
  for (const std::uint8_t* descriptor : descriptors) {
    int sq = 0;
    for (std::size_t i = 0; i < kDescriptorSize; ++i) {
      sum[i] += descriptor[i];
      sq += descriptor[i] * descriptor[i];
    }
    length += std::sqrt(static_cast<double>(sq));
  }
  double sum_sq = 0;
  for (const int value : sum) sum_sq += static_cast<double>(value) * value;
  const double scale =
      sum_sq > 0 ? length / static_cast<double>(descriptors.size()) / std::sqrt(sum_sq) : 0;
  std::array<std::uint8_t, kDescriptorSize> mean;
  for (std::size_t i = 0; i < kDescriptorSize; ++i) {
    mean[i] = static_cast<std::uint8_t>(std::min(255.0, std::round(sum[i] * scale)));
  }
  return mean;
}

MergedLandmarks MergeObservations(const LayerInput& input,
                                  std::span<const LandmarkObservation> observations) {
  std::vector<std::vector<const LandmarkObservation*>> of_panorama(input.panoramas.size());
  for (const LandmarkObservation& o : observations) {
    if (o.panorama >= input.panoramas.size()) {
      throw std::logic_error(Format("observation of panorama %u; only %zu are given", o.panorama,
                                    input.panoramas.size()));
    }
    if (IsUsable(o)) of_panorama[o.panorama].push_back(&o);
  }
  MergedLandmarks merged(input.panoramas.size());
  tbb::parallel_for(std::size_t{0}, merged.size(),
                    [&](std::size_t p) { merged[p] = MergeOne(input, std::move(of_panorama[p])); });
  return merged;
}

}  // namespace panofix
