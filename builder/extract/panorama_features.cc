#include "builder/extract/panorama_features.h"

#include <cmath>
#include <stdexcept>

#include "common/base/log.h"
#include "common/geometry/attitude.h"
#include "common/image/gray_image.h"

namespace panofix {
namespace {

constexpr std::size_t kMaxMaskBytes = std::size_t{64} << 20;

// Two unit vectors that span the plane normal to `ray`.
std::array<Eigen::Vector3d, 2> Tangents(const Eigen::Vector3d& ray) {
  const Eigen::Vector3d u = ray.unitOrthogonal();
  return {u, ray.cross(u)};
}

// Largest difference of range within a depth pixel's width around the ray: a depth edge may put a
// keypoint on either surface.
double EdgeStep_m(const DepthMap& depth, const Eigen::Vector3d& ray, const DepthHit& hit) {
  const double pixel_rad = 2 * M_PI / depth.width();
  double step_m = 0;
  for (const Eigen::Vector3d& tangent : Tangents(ray)) {
    for (const double sign : {-1.0, 1.0}) {
      const Eigen::Vector3d beside = (ray + sign * pixel_rad * tangent).normalized();
      const auto other = depth.Cast(beside);
      if (!other) continue;  // the sky behind an edge is no rival surface
      // Range that the hit's own plane would have there.
      const double same_m =
          hit.range_m * hit.normal_in_pano.dot(ray) / hit.normal_in_pano.dot(beside);
      if (std::isfinite(same_m)) step_m = std::max(step_m, std::abs(other->range_m - same_m));
    }
  }
  return step_m;
}

bool IsMasked(const GrayImage& mask, const Keypoint& keypoint) {
  if (mask.empty()) return false;
  const int x = static_cast<int>(std::lround(keypoint.x_px)),
            y = static_cast<int>(std::lround(keypoint.y_px));
  if (x < 0 || y < 0 || x >= mask.width_px || y >= mask.height_px) return false;
  return mask.pixels[static_cast<std::size_t>(y) * static_cast<std::size_t>(mask.width_px) +
                     static_cast<std::size_t>(x)] != 0;
}

// Drops features on the mask: the capture car travels along and would match itself everywhere.
FeatureSet Unmasked(const FeatureSet& all, const GrayImage& mask) {
  if (mask.empty()) return all;
  FeatureSet kept;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (IsMasked(mask, all.keypoints[i])) continue;
    kept.keypoints.push_back(all.keypoints[i]);
    const auto descriptor = all.descriptor(i);
    kept.descriptors.insert(kept.descriptors.end(), descriptor.begin(), descriptor.end());
  }
  return kept;
}

}  // namespace

void ExtractOptions::Check() const {
  features.Check();
  const auto require = [](bool holds, const std::string& message) {
    if (!holds) throw std::invalid_argument(message);
  };
  require(max_range_m > 1, Format("max_range_m = %g; must be above 1", max_range_m));
  require(max_incidence_deg > 0 && max_incidence_deg < 90,
          Format("max_incidence_deg = %g; must lie in (0, 90)", max_incidence_deg));
  require(
      errors.range_sigma_share >= 0 && errors.relief_sigma_m >= 0 && errors.normal_sigma_deg >= 0,
      "map errors must not be negative");
}

std::optional<SurfacePoint> PointOnSurface(const DepthMap& depth,
                                           const Eigen::Vector3d& ray_in_pano,
                                           const ExtractOptions& options) {
  const auto hit = depth.Cast(ray_in_pano);
  if (!hit || !(hit->range_m > 0.3) || hit->range_m > options.max_range_m) return std::nullopt;
  const double cosine = std::abs(hit->normal_in_pano.dot(ray_in_pano));
  if (cosine < std::cos(options.max_incidence_deg * kRadPerDeg)) return std::nullopt;
  const double tangent = std::sqrt(std::max(0.0, 1 - cosine * cosine)) / cosine;
  const double from_distance_m = options.errors.range_sigma_share * hit->range_m;
  const double from_normal_m =
      hit->range_m * tangent * options.errors.normal_sigma_deg * kRadPerDeg;
  const double from_relief_m = options.errors.relief_sigma_m / cosine;
  const double from_edge_m = 0.5 * EdgeStep_m(depth, ray_in_pano, *hit);
  const double sigma_m =
      std::sqrt(from_distance_m * from_distance_m + from_normal_m * from_normal_m +
                from_relief_m * from_relief_m + from_edge_m * from_edge_m);
  SurfacePoint point;
  point.point_in_pano = (hit->range_m * ray_in_pano).cast<float>();
  point.surface_idx = static_cast<std::uint8_t>(hit->surface_idx);
  point.range_sigma_m = std::max(1e-3F, static_cast<float>(sigma_m));
  return point;
}

Result<GrayImage> ReadMask(const PanoramaRecord& record) {
  if (record.mask.empty()) return GrayImage{};
  auto bytes = ReadFileBytes(record.mask, kMaxMaskBytes);
  if (!bytes.ok()) return bytes.status();
  auto mask = DecodeGray(*bytes);
  if (!mask.ok())
    return Status(mask.status().code(), record.mask.string() + ": " + mask.status().message());
  return mask;
}

std::optional<DepthMap> ReadUsableDepth(const PanoramaRecord& record, std::string* fault) {
  if (record.depth.empty()) return std::nullopt;
  auto depth = DepthMap::Read(record.depth, record.depth_scale_m);
  if (!depth.ok()) {
    *fault = depth.status().message();
    return std::nullopt;
  }
  if (depth->is_placeholder()) {
    *fault = record.depth.string() + ": a placeholder of at most 2 planes, no measurement";
    return std::nullopt;
  }
  return std::move(depth).value();
}

Result<PanoramaFeatures> ExtractPanorama(const PanoramaRecord& record, const Rectifier& rectifier,
                                         const ExtractOptions& options) {
  Status status = CheckPanoramaFiles(record);
  if (!status.ok()) return status;
  auto image = DecodePanorama(record.image, rectifier.camera());
  if (!image.ok()) return image.status();
  auto mask = ReadMask(record);
  if (!mask.ok()) return mask.status();

  PanoramaFeatures result;
  result.sources = {record.id};
  const std::optional<DepthMap> depth = ReadUsableDepth(record, &result.depth_fault);
  result.has_depth = depth.has_value();
  if (depth) result.planes = depth->planes();
  for (int v = 0; v < static_cast<int>(rectifier.directions().size()); ++v) {
    const GrayImage view = Preprocess(rectifier.Cut(*image, v), options.features);
    const GrayImage view_mask = mask->empty() ? GrayImage{} : rectifier.CutMask(*mask, v);
    ViewFeatureSet set;
    set.sift = Unmasked(ExtractSift(view, options.features), view_mask);
    set.mser = Unmasked(ExtractMser(view, options.features), view_mask);
    set.points.resize(set.sift.size());
    const Eigen::Matrix3d pano_from_cam =
        PanoFromCam(rectifier.directions()[static_cast<std::size_t>(v)]);
    for (std::size_t i = 0; depth && i < set.sift.size(); ++i) {
      const Keypoint& k = set.sift.keypoints[i];
      const Eigen::Vector2d n = rectifier.camera().Normalize({double{k.x_px}, double{k.y_px}});
      const Eigen::Vector3d ray = pano_from_cam * Eigen::Vector3d(n.x(), n.y(), 1).normalized();
      set.points[i] = PointOnSurface(*depth, ray, options).value_or(SurfacePoint{});
    }
    result.views.push_back(std::move(set));
  }
  return result;
}

}  // namespace panofix
