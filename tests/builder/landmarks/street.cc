#include "tests/builder/landmarks/street.h"

#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>

#include "common/features/matcher.h"

namespace panofix {
namespace {

constexpr double kRadPerDegree = std::numbers::pi / 180;
constexpr double kHeight_m = 2.5, kHalfWidth_m = 8, kEnd_m = 14;

Eigen::Vector3d Normal3(Rng* rng, double sigma) {
  Eigen::Vector3d v;
  for (int k = 0; k < 3; ++k) v[k] = sigma * rng->Normal();
  return v;
}

// Surfaces 1..5 in local: left, right, ground, both ends; n . X = d.
struct Surface {
  Eigen::Vector3d normal;
  double d_m;
};

std::vector<Surface> Surfaces(double length_m) {
  return {{{0, 1, 0}, kHalfWidth_m},
          {{0, -1, 0}, kHalfWidth_m},
          {{0, 0, -1}, 0},
          {{1, 0, 0}, length_m + kEnd_m},
          {{-1, 0, 0}, kEnd_m}};
}

Eigen::Vector3d PointOn(std::size_t surface, double length_m, Rng* rng) {
  const double x = rng->Uniform(-kEnd_m, length_m + kEnd_m),
               y = rng->Uniform(-kHalfWidth_m, kHalfWidth_m);
  const double z = rng->Uniform(0, 8);
  if (surface < 2) return {x, surface == 0 ? kHalfWidth_m : -kHalfWidth_m, z};
  if (surface == 2) return {x, y, 0};
  return {surface == 3 ? length_m + kEnd_m : -kEnd_m, y, z};
}

class StreetMaker {
 public:
  StreetMaker(const StreetOptions& options, std::uint64_t seed)
      : options_(options),
        rng_(seed, "test/street"),
        length_m_(options.spacing_m * (options.num_panoramas - 1)),
        surfaces_(Surfaces(length_m_)) {
    street_.focal_px = options.focal_px;
    street_.errors.range_sigma_share = options.range_sigma_share;
    street_.errors.normal_sigma_deg = options.normal_sigma_deg;
    street_.errors.relief_sigma_m = options.relief_sigma_m;
    // What the layer is told is never zero.
    street_.errors.panorama_position_sigma_m = std::max(0.01, options.position_sigma_m);
    street_.errors.panorama_heading_sigma_deg = std::max(0.02, options.heading_sigma_deg);
  }

  Street Make() {
    for (int p = 0; p < options_.num_panoramas; ++p) AddPanorama(p);
    for (int i = 0; i < options_.num_points; ++i) AddPoint(i);
    for (std::size_t k = 0; k < street_.observations.size(); ++k) {
      street_.observations[k] = WithDescriptor(street_.observations[k], street_.storage[k]);
    }
    return std::move(street_);
  }

 private:
  static LandmarkObservation WithDescriptor(
      const LandmarkObservation& o, const std::array<std::uint8_t, kDescriptorSize>& bytes) {
    return {o.view,      o.panorama, o.surface_idx, o.point_in_pano, o.range_sigma_m, o.size_m,
            o.angle_deg, o.response, bytes};
  }

  void AddPanorama(int p) {
    const Eigen::AngleAxisd heading(0.3 * p, Eigen::Vector3d::UnitZ());
    const Rigid3 truth(Eigen::Quaterniond(heading),
                       {options_.spacing_m * p, 0.4 * (p % 2), kHeight_m});
    const Eigen::Quaterniond turn =
        ExpSo3(Normal3(&rng_, options_.heading_sigma_deg * kRadPerDegree));
    LandmarkPanorama panorama;
    panorama.local_from_pano = {(turn * truth.rotation).normalized(),
                                truth.translation + Normal3(&rng_, options_.position_sigma_m)};
    std::vector<DepthPlane> planes(1), true_planes(1);
    for (const Surface& surface : surfaces_) {
      const Eigen::Vector3d n = truth.rotation.conjugate() * surface.normal;
      const double d_m = surface.d_m - surface.normal.dot(truth.translation);
      true_planes.push_back({n.cast<float>(), static_cast<float>(d_m)});
      const Eigen::Vector3d e1 = n.unitOrthogonal(), e2 = n.cross(e1);
      const double tilt = options_.normal_sigma_deg * kRadPerDegree;
      const Eigen::Vector3d tilted = n + tilt * rng_.Normal() * e1 + tilt * rng_.Normal() * e2;
      planes.push_back(
          {tilted.normalized().cast<float>(),
           static_cast<float>(d_m * (1 + options_.range_sigma_share * rng_.Normal()))});
    }
    planes_.push_back(planes);
    if (options_.planes_are_known) panorama.planes = planes;
    street_.panoramas.push_back(panorama);
    street_.true_local_from_pano.push_back(truth);
    street_.true_planes.push_back(true_planes);
  }

  void AddPoint(int idx) {
    const std::size_t surface = static_cast<std::size_t>(idx) % surfaces_.size();
    const Eigen::Vector3d point =
        PointOn(surface, length_m_, &rng_) +
        options_.relief_sigma_m * rng_.Normal() * surfaces_[surface].normal;
    street_.points_in_local.push_back(point);
    street_.true_descriptors.push_back(RandomDescriptor(&rng_));
    size_m_ = std::exp(rng_.Uniform(std::log(0.05), std::log(0.5)));
    angle_deg_ = rng_.Uniform(0, 360);
    for (std::uint32_t p = 0; p < street_.panoramas.size(); ++p) Observe(idx, surface, p);
  }

  void Observe(int idx, std::size_t surface, std::uint32_t p) {
    const bool is_outlier = rng_.Uniform() < options_.outlier_share;
    Eigen::Vector3d seen = street_.points_in_local[static_cast<std::size_t>(idx)];
    if (is_outlier) {  // in the surface, within reach of matching
      const Eigen::Vector3d away = Normal3(&rng_, 1).cross(surfaces_[surface].normal).normalized();
      seen += rng_.Uniform(0.15, 0.5) * away;
    }
    const Eigen::Vector3d x = street_.true_local_from_pano[p].Inverse() * seen;
    const double range_m = x.norm();
    if (range_m > options_.max_range_m) return;
    // One error a panorama: its views are cut from the same picture.
    const double sigma_m =
        options_.keypoint_share * std::max(0.12 * size_m_, 0.7 * range_m / options_.focal_px);
    const Eigen::Vector3d ray = (x + Normal3(&rng_, sigma_m).cross(x.normalized())).normalized();
    const DepthPlane& plane = planes_[p][surface + 1];
    const Eigen::Vector3d n = plane.normal_in_pano.cast<double>();
    const double cosine = n.dot(ray), seen_range_m = double{plane.d_m} / cosine;
    constexpr double kLeastCosine = 0.15;
    if (cosine < kLeastCosine || seen_range_m > 2 * options_.max_range_m) return;
    const double tangent = std::sqrt(1 / (cosine * cosine) - 1);
    const MapErrors& e = street_.errors;
    LandmarkObservation o{0,
                          p,
                          static_cast<std::uint8_t>(options_.planes_are_known ? surface + 1 : 0),
                          (seen_range_m * ray).cast<float>(),
                          0,
                          static_cast<float>(size_m_),
                          0,
                          0,
                          kNoDescriptor};
    o.range_sigma_m =
        static_cast<float>(std::hypot(seen_range_m * e.range_sigma_share, e.relief_sigma_m / cosine,
                                      seen_range_m * tangent * e.normal_sigma_deg * kRadPerDegree) +
                           1e-3);
    o.response = static_cast<float>(rng_.Uniform(0.03, 0.1));
    const auto descriptor = street_.true_descriptors[static_cast<std::size_t>(idx)];
    for (int v = 0; v < options_.views_per_point; ++v) {
      o.view = p * 8 + static_cast<std::uint32_t>((idx + v) % 8);
      o.angle_deg = static_cast<float>(std::fmod(angle_deg_ + rng_.Uniform(0, 4), 360.0));
      street_.observations.push_back(o);
      street_.storage.push_back(Disturbed(descriptor, options_.descriptor_noise, &rng_));
      street_.point_of.push_back(is_outlier ? -1 : idx);
    }
  }

  static constexpr std::array<std::uint8_t, kDescriptorSize> kNoDescriptor{};
  const StreetOptions options_;
  Rng rng_;
  const double length_m_;
  const std::vector<Surface> surfaces_;
  std::vector<std::vector<DepthPlane>> planes_;  // with errors, whether known or not
  double size_m_ = 0, angle_deg_ = 0;
  Street street_;
};

template <typename T>
void Append(const T& value, std::vector<std::uint8_t>* bytes) {
  const auto* begin = reinterpret_cast<const std::uint8_t*>(&value);
  bytes->insert(bytes->end(), begin, begin + sizeof(T));
}

}  // namespace

Street MakeStreet(const StreetOptions& options, std::uint64_t seed) {
  return StreetMaker(options, seed).Make();
}

std::array<std::uint8_t, kDescriptorSize> RandomDescriptor(Rng* rng) {
  std::array<double, kDescriptorSize> raw;
  double sq = 0;
  for (double& value : raw) {
    value = std::abs(rng->Normal());
    sq += value * value;
  }
  std::array<std::uint8_t, kDescriptorSize> bytes;
  for (std::size_t i = 0; i < kDescriptorSize; ++i) {
    bytes[i] = static_cast<std::uint8_t>(std::min(255.0, 512 * raw[i] / std::sqrt(sq)));
  }
  return bytes;
}

std::array<std::uint8_t, kDescriptorSize> Disturbed(
    const std::array<std::uint8_t, kDescriptorSize>& descriptor, double sigma, Rng* rng) {
  std::array<std::uint8_t, kDescriptorSize> bytes;
  for (std::size_t i = 0; i < kDescriptorSize; ++i) {
    bytes[i] =
        static_cast<std::uint8_t>(std::clamp(descriptor[i] + sigma * rng->Normal(), 0.0, 255.0));
  }
  return bytes;
}

std::vector<std::uint8_t> Bytes(const LandmarkLayer& layer) {
  std::vector<std::uint8_t> bytes;
  for (const Landmark& l : layer.landmarks) {
    Append(l.panorama, &bytes);
    for (const float value : {l.point_in_pano.x(), l.point_in_pano.y(), l.point_in_pano.z(),
                              l.range_sigma_m, l.point_sigma_m, l.size_m, l.angle_deg}) {
      Append(value, &bytes);
    }
    bytes.push_back(l.surface_idx), bytes.push_back(l.num_panoramas);
    bytes.insert(bytes.end(), l.descriptor.begin(), l.descriptor.end());
    for (const std::uint32_t view : l.views) Append(view, &bytes);
  }
  for (const PanoramaRefinement& p : layer.panoramas) {
    for (int k = 0; k < 4; ++k) Append(p.local_from_pano.rotation.coeffs()[k], &bytes);
    for (int k = 0; k < 3; ++k) Append(p.local_from_pano.translation[k], &bytes);
    for (const DepthPlane& plane : p.planes) {
      for (int k = 0; k < 3; ++k) Append(plane.normal_in_pano[k], &bytes);
      Append(plane.d_m, &bytes);
    }
    for (const float value : p.distance_sigma_share) Append(value, &bytes);
    for (const float value : p.normal_sigma_rad) Append(value, &bytes);
    Append(p.residual_after_px, &bytes), Append(p.num_tracks, &bytes), Append(p.is_flagged, &bytes);
  }
  return bytes;
}

std::size_t PointOf(const Street& street, const Landmark& landmark) {
  std::size_t best = 0;
  int best_sq = std::numeric_limits<int>::max();
  for (std::size_t i = 0; i < street.true_descriptors.size(); ++i) {
    const int sq =
        DescriptorDistanceSq(landmark.descriptor.data(), street.true_descriptors[i].data());
    if (sq < best_sq) best_sq = sq, best = i;
  }
  return best;
}

}  // namespace panofix
