#include "builder/ingest/depth_map.h"

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "builder/ingest/depth_payload.h"
#include "common/base/log.h"
#include "common/image/gray_image.h"

namespace panofix {
namespace {

constexpr std::size_t kMaxDepthFileBytes = std::size_t{64} << 20;

// Azimuth and elevation of a ray as fractional pixel coordinates, the inverse of PixelRay.
Eigen::Vector2d PixelOfRay(const Eigen::Vector3d& ray_in_pano, int width, int height) {
  const double azimuth = std::atan2(ray_in_pano.x(), ray_in_pano.y());
  const double elevation = std::atan2(ray_in_pano.z(), ray_in_pano.head<2>().norm());
  return {(azimuth / (2 * std::numbers::pi) + 0.5) * width - 0.5,
          (0.5 - elevation / std::numbers::pi) * height - 0.5};
}

int NearestColumn(double column, int width) {
  const int nearest = static_cast<int>(std::floor(column + 0.5));
  return (nearest % width + width) % width;
}

int NearestRow(double row, int height) {
  return static_cast<int>(std::clamp(std::floor(row + 0.5), 0.0, height - 1.0));
}

// Neighbours within this ratio of range are taken as one surface: a wall seen at 3 degrees changes
// by 1.25 over one column of 512; real depth edges are mostly larger, and a wrong join stays small.
constexpr double kMaxSurfaceRatio = 1.25;
bool SameSurface(double a_m, double b_m) {
  return a_m > 0 && b_m > 0 && a_m < kMaxSurfaceRatio * b_m && b_m < kMaxSurfaceRatio * a_m;
}

}  // namespace

Result<DepthMap> DepthMap::DecodeGsv(std::string_view text) {
  const auto bytes = DecodeBase64(text);
  if (!bytes.ok()) return bytes.status();
  Result<DepthPayload> payload = ParseDepthPayload(*bytes);
  if (!payload.ok()) return payload.status();
  DepthMap map(payload->width, payload->height);
  map.is_zlib_ = payload->is_zlib;
  map.planes_ = std::move(payload->planes);
  map.plane_idx_ = std::move(payload->plane_idx);
  return map;
}

Result<DepthMap> DepthMap::DecodePng(std::span<const std::uint8_t> bytes, double scale_m) {
  if (!std::isfinite(scale_m) || scale_m <= 0) {
    return Status(ErrorCode::kInvalidArgument,
                  Format("depth_scale %g; give the metres of one step, above 0", scale_m));
  }
  DecodeLimits limits;
  limits.max_pixels = std::int64_t{8} * kMaxDepthWidth * kMaxDepthWidth;
  const Result<Gray16Image> image = DecodePng16(bytes, limits);
  if (!image.ok()) return image.status();
  if (image->width_px != 2 * image->height_px) {
    return Status(ErrorCode::kBadData,
                  Format("depth is %dx%d; write it over the whole panorama, width twice the height",
                         image->width_px, image->height_px));
  }
  DepthMap map(image->width_px, image->height_px);
  map.range_m_.reserve(image->pixels.size());
  for (const std::uint16_t value : image->pixels) {
    map.range_m_.push_back(static_cast<float>(value * scale_m));
  }
  return map;
}

Result<DepthMap> DepthMap::Read(const std::filesystem::path& path, double scale_m) {
  const std::string extension = path.extension().string();
  if (extension != ".gsv" && extension != ".png") {
    return Status(ErrorCode::kBadData,
                  path.string() + ": depth of unknown kind; give a .gsv or a 16-bit .png");
  }
  const auto bytes = ReadFileBytes(path, kMaxDepthFileBytes);
  if (!bytes.ok()) return bytes.status();
  Result<DepthMap> map =
      extension == ".gsv" ? DecodeGsv({reinterpret_cast<const char*>(bytes->data()), bytes->size()})
                          : DecodePng(*bytes, scale_m);
  if (map.ok()) return map;
  return Status(map.status().code(), path.string() + ": " + map.status().message());
}

std::size_t DepthMap::PixelIndex(int column, int row) const {
  if (column < 0 || column >= width_ || row < 0 || row >= height_) {
    throw std::out_of_range(
        Format("depth pixel %d,%d outside %dx%d", column, row, width_, height_));
  }
  return static_cast<std::size_t>(row) * static_cast<std::size_t>(width_) +
         static_cast<std::size_t>(column);
}

int DepthMap::PlaneIndex(int column, int row) const {
  const std::size_t i = PixelIndex(column, row);
  return plane_idx_.empty() ? 0 : plane_idx_[i];
}

double DepthMap::SurfaceShare() const {
  const auto has_surface = [](auto value) { return value > 0; };
  const auto num_surface = plane_idx_.empty()
                               ? std::count_if(range_m_.begin(), range_m_.end(), has_surface)
                               : std::count_if(plane_idx_.begin(), plane_idx_.end(), has_surface);
  return static_cast<double>(num_surface) / (static_cast<double>(width_) * height_);
}

std::optional<int> DepthMap::GroundPlane() const {
  if (planes_.empty()) return std::nullopt;
  std::vector<std::int64_t> num_pixels(planes_.size(), 0);
  for (std::size_t i = PixelIndex(0, height_ * 3 / 4); i < plane_idx_.size(); ++i) {
    ++num_pixels[plane_idx_[i]];
  }
  constexpr float kMinUpShare = 0.9F;
  std::optional<int> best;
  for (std::size_t i = 1; i < planes_.size(); ++i) {
    const Eigen::Vector3f& n = planes_[i].normal_in_pano;
    if (num_pixels[i] == 0 || !(std::abs(n.z()) > kMinUpShare * n.norm())) continue;
    if (!best || num_pixels[i] > num_pixels[static_cast<std::size_t>(*best)])
      best = static_cast<int>(i);
  }
  return best;
}

Eigen::Vector3d DepthMap::PixelRay(double column, double row) const {
  const double azimuth = ((column + 0.5) / width_ - 0.5) * 2 * std::numbers::pi;
  const double elevation = (0.5 - (row + 0.5) / height_) * std::numbers::pi;
  return {std::cos(elevation) * std::sin(azimuth), std::cos(elevation) * std::cos(azimuth),
          std::sin(elevation)};
}

std::optional<DepthHit> DepthMap::Cast(const Eigen::Vector3d& ray_in_pano) const {
  const Eigen::Vector2d pixel = PixelOfRay(ray_in_pano, width_, height_);
  return CastAt(pixel.x(), pixel.y(), ray_in_pano);
}

std::optional<DepthHit> DepthMap::CastAt(double column, double row,
                                         const Eigen::Vector3d& ray_in_pano) const {
  // Also keeps the conversions to whole pixels defined.
  if (!ray_in_pano.allFinite() || !(std::abs(column) <= 2.0 * width_) || !std::isfinite(row)) {
    return std::nullopt;
  }
  if (planes_.empty()) return CastRaster(column, row, ray_in_pano);
  const int nearest_column = NearestColumn(column, width_), nearest_row = NearestRow(row, height_);
  return CastPlane(plane_idx_[PixelIndex(nearest_column, nearest_row)], ray_in_pano);
}

std::optional<DepthHit> DepthMap::CastPixel(int column, int row) const {
  const std::size_t i = PixelIndex(column, row);
  const Eigen::Vector3d ray_in_pano = PixelRay(column, row);
  return planes_.empty() ? CastRaster(column, row, ray_in_pano)
                         : CastPlane(plane_idx_[i], ray_in_pano);
}

std::optional<DepthHit> DepthMap::CastPlane(int plane_idx,
                                            const Eigen::Vector3d& ray_in_pano) const {
  if (plane_idx == 0) return std::nullopt;
  const DepthPlane& plane = planes_[static_cast<std::size_t>(plane_idx)];
  const Eigen::Vector3d n = plane.normal_in_pano.cast<double>();
  const double along = ray_in_pano.dot(n);
  DepthHit hit;
  hit.range_m = std::abs(plane.d_m / along);
  if (!std::isfinite(hit.range_m) || hit.range_m <= 0) return std::nullopt;
  hit.normal_in_pano =
      along > 0 ? Eigen::Vector3d(-n.normalized()) : Eigen::Vector3d(n.normalized());
  hit.surface_idx = plane_idx;
  return hit;
}

std::optional<DepthHit> DepthMap::CastRaster(double column, double row,
                                             const Eigen::Vector3d& ray_in_pano) const {
  const int nearest_column = NearestColumn(column, width_), nearest_row = NearestRow(row, height_);
  DepthHit hit;
  hit.range_m = range_m_[PixelIndex(nearest_column, nearest_row)];
  if (hit.range_m <= 0) return std::nullopt;
  hit.normal_in_pano = RasterNormal(nearest_column, nearest_row, ray_in_pano);
  // Inverse range is linear in the ray on a plane, so it is what bilinear weights fit.
  const double left = std::floor(column);
  const double top = std::floor(std::clamp(row, 0.0, height_ - 1.0));
  const double fx = column - left, fy = std::clamp(row, 0.0, height_ - 1.0) - top;
  double inverse_range = 0;
  for (int corner = 0; corner < 4; ++corner) {
    const double weight = (corner % 2 == 0 ? 1 - fx : fx) * (corner / 2 == 0 ? 1 - fy : fy);
    if (weight == 0) continue;
    const int c = NearestColumn(left + corner % 2, width_);
    const int r = NearestRow(top + corner / 2, height_);
    const double range_m = range_m_[PixelIndex(c, r)];
    if (!SameSurface(range_m, hit.range_m)) return hit;  // an edge: the nearest pixel's own range
    inverse_range += weight / range_m;
  }
  hit.range_m = 1 / inverse_range;
  return hit;
}

// From the tangents to the neighbours on the same surface; towards the panorama where there are
// none.
Eigen::Vector3d DepthMap::RasterNormal(int column, int row,
                                       const Eigen::Vector3d& ray_in_pano) const {
  const double range_m = range_m_[PixelIndex(column, row)];
  const Eigen::Vector3d centre = range_m * PixelRay(column, row);
  const auto tangent = [&](int dc, int dr) -> Eigen::Vector3d {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const int sign : {-1, 1}) {
      const int r = row + sign * dr;
      if (r < 0 || r >= height_) continue;
      const int c = (column + sign * dc + width_) % width_;
      const double neighbour_m = range_m_[PixelIndex(c, r)];
      if (SameSurface(neighbour_m, range_m)) sum += sign * (neighbour_m * PixelRay(c, r) - centre);
    }
    return sum;
  };
  const Eigen::Vector3d normal = tangent(1, 0).cross(tangent(0, 1));
  if (!(normal.norm() > 0)) return -ray_in_pano.normalized();
  return (normal.dot(ray_in_pano) > 0 ? -normal : normal).normalized();
}

}  // namespace panofix
