#include "builder/augment/render_source.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <utility>

namespace panofix {
namespace {

constexpr int kNumLevels = 4;
// Outline points are drawn in to here: seen from stations near by, farther ones look the same.
constexpr double kMaxOutlineRange_m = 1000;

PyramidLevel MakeLevel(const cv::Mat& image, const cv::Mat& full) {
  PyramidLevel level{image.cols,
                     image.rows,
                     static_cast<double>(image.cols) / full.cols,
                     static_cast<double>(image.rows) / full.rows,
                     {}};
  level.padded.resize(static_cast<std::size_t>(image.cols + 1) *
                      static_cast<std::size_t>(image.rows + 1));
  cv::Mat padded(image.rows + 1, image.cols + 1, CV_8UC1, level.padded.data());
  image.copyTo(padded(cv::Rect(0, 0, image.cols, image.rows)));
  padded.col(0).copyTo(padded.col(image.cols));
  padded.row(image.rows - 1).copyTo(padded.row(image.rows));
  return level;
}

std::vector<PyramidLevel> MakePyramid(const GrayImage& panorama) {
  // OpenCV has no view of constant pixels; nothing writes through this one.
  const cv::Mat full(panorama.height_px, panorama.width_px, CV_8UC1,
                     const_cast<std::uint8_t*>(panorama.pixels.data()));
  std::vector<PyramidLevel> levels = {MakeLevel(full, full)};
  cv::Mat image = full;
  while (levels.size() < kNumLevels && image.rows >= 2) {
    cv::Mat half;
    cv::resize(image, half, cv::Size(image.cols / 2, image.rows / 2), 0, 0, cv::INTER_AREA);
    levels.push_back(MakeLevel(half, full));
    image = half;
  }
  return levels;
}

// Whether any mask pixel under a depth pixel is set.
bool IsMasked(const GrayImage& mask, const DepthMap& depth, int column, int row) {
  if (mask.empty()) return false;
  const auto first = [](int i, int from, int to) { return i * to / from; };
  const auto last = [](int i, int from, int to) { return ((i + 1) * to + from - 1) / from - 1; };
  for (int y = first(row, depth.height(), mask.height_px);
       y <= last(row, depth.height(), mask.height_px); ++y) {
    for (int x = first(column, depth.width(), mask.width_px);
         x <= last(column, depth.width(), mask.width_px); ++x) {
      if (mask.pixels[static_cast<std::size_t>(y) * static_cast<std::size_t>(mask.width_px) +
                      static_cast<std::size_t>(x)] != 0) {
        return true;
      }
    }
  }
  return false;
}

// A plane that faces away from the panorama as most of its pixels see it; d_m 0 where degenerate.
RenderSurface OrientedSurface(const DepthPlane& plane, int plane_idx, int facing_votes) {
  const Eigen::Vector3d n = plane.normal_in_pano.cast<double>();
  RenderSurface surface{n, 0, plane_idx, {}};
  if (!(n.norm() > 0)) return surface;
  surface.normal_in_pano = (facing_votes >= 0 ? 1 : -1) * n.normalized();
  surface.d_m = std::abs(double{plane.d_m}) / n.norm();
  return surface;
}

}  // namespace

PanoramaShare ShareOfDirection(const Eigen::Vector3d& direction_in_pano) {
  const Eigen::Vector3d& v = direction_in_pano;
  double across = std::atan2(v.x(), v.y()) / (2 * std::numbers::pi) + 0.5;
  if (across >= 1) across = 0;  // straight back is the left edge
  return {across, 0.5 - std::atan2(v.z(), v.head<2>().norm()) / std::numbers::pi};
}

RenderSource::Impl::Impl(const GrayImage& panorama, const GrayImage& mask, DepthMap given)
    : depth(std::move(given)), levels(MakePyramid(panorama)) {
  // A placeholder is no depth, and a raster names no surface to intersect: such a source gives
  // nothing. Marching rays through the raster could serve, where rasters are common.
  if (depth.planes().empty() || depth.is_placeholder()) return;
  FindSurfaces(mask);
  FindOutlines();
}

void RenderSource::Impl::FindSurfaces(const GrayImage& mask) {
  const std::vector<DepthPlane>& planes = depth.planes();
  surface_of_pixel.assign(
      static_cast<std::size_t>(depth.width()) * static_cast<std::size_t>(depth.height()), 0);
  std::vector<int> num_pixels(planes.size(), 0), facing_votes(planes.size(), 0);
  std::size_t i = 0;
  for (int row = 0; row < depth.height(); ++row) {
    for (int column = 0; column < depth.width(); ++column, ++i) {
      const int plane_idx = depth.PlaneIndex(column, row);
      if (plane_idx == 0 || IsMasked(mask, depth, column, row)) continue;
      const auto p = static_cast<std::size_t>(plane_idx);
      const double along = depth.PixelRay(column, row).dot(planes[p].normal_in_pano.cast<double>());
      ++num_pixels[p];
      facing_votes[p] += along > 0 ? 1 : -1;
      surface_of_pixel[i] = static_cast<std::uint8_t>(plane_idx);
    }
  }
  std::vector<std::uint8_t> surface_of_plane(planes.size(), 0);
  for (std::size_t p = 1; p < planes.size(); ++p) {
    if (num_pixels[p] == 0) continue;
    const RenderSurface surface = OrientedSurface(planes[p], static_cast<int>(p), facing_votes[p]);
    if (!(surface.d_m > 0)) continue;
    surfaces.push_back(surface);
    surface_of_plane[p] = static_cast<std::uint8_t>(surfaces.size());
  }
  for (std::uint8_t& surface : surface_of_pixel) surface = surface_of_plane[surface];
}

void RenderSource::Impl::FindOutlines() {
  const int width = depth.width(), height = depth.height();
  const auto surface_at = [&](int column, int row) {
    return surface_of_pixel[static_cast<std::size_t>(row) * static_cast<std::size_t>(width) +
                            static_cast<std::size_t>((column + width) % width)];
  };
  for (int row = 0; row < height; ++row) {
    for (int column = 0; column < width; ++column) {
      const std::uint8_t own = surface_at(column, row);
      if (own == 0) continue;
      const bool is_inside = surface_at(column - 1, row) == own &&
                             surface_at(column + 1, row) == own &&
                             (row == 0 || surface_at(column, row - 1) == own) &&
                             (row == height - 1 || surface_at(column, row + 1) == own);
      if (is_inside) continue;
      RenderSurface& surface = surfaces[own - std::size_t{1}];
      for (const int corner : {0, 1, 2, 3}) {
        const Eigen::Vector3d ray =
            depth.PixelRay(column + (corner % 2 == 0 ? -1 : 1), row + (corner / 2 == 0 ? -1 : 1));
        const double range_m = surface.d_m / surface.normal_in_pano.dot(ray);
        const bool is_near = range_m > 0 && range_m < kMaxOutlineRange_m;
        surface.outline_in_pano.emplace_back(
            ((is_near ? range_m : kMaxOutlineRange_m) * ray).cast<float>());
      }
    }
  }
}

int RenderSource::Impl::SurfaceAt(const PanoramaShare& share) const {
  const int column = std::min(static_cast<int>(share.across * depth.width()), depth.width() - 1);
  const int row = std::min(static_cast<int>(share.down * depth.height()), depth.height() - 1);
  return surface_of_pixel[static_cast<std::size_t>(row) * static_cast<std::size_t>(depth.width()) +
                          static_cast<std::size_t>(column)];
}

std::array<int, 4> RenderSource::Impl::SurfacesAround(const PanoramaShare& share) const {
  const double half_across = 0.5 / depth.width(), half_down = 0.5 / depth.height();
  std::array<int, 4> around{};
  for (std::size_t i = 0; i < 4; ++i) {
    PanoramaShare corner{share.across + (i % 2 == 0 ? -half_across : half_across),
                         share.down + (i / 2 == 0 ? -half_down : half_down)};
    if (corner.across < 0) corner.across += 1;
    if (corner.across >= 1) corner.across -= 1;
    corner.down = std::clamp(corner.down, 0.0, 1.0);
    around[i] = SurfaceAt(corner);
  }
  return around;
}

RenderSource::RenderSource(GrayImage panorama, GrayImage mask, DepthMap depth) {
  if (panorama.empty()) throw std::invalid_argument("panorama is empty");
  impl_ = std::make_unique<Impl>(panorama, mask, std::move(depth));
}
RenderSource::~RenderSource() = default;
RenderSource::RenderSource(RenderSource&&) noexcept = default;
const DepthMap& RenderSource::depth() const { return impl_->depth; }

}  // namespace panofix
