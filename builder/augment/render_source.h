#pragma once
// Inside a RenderSource: what rendering asks of a panorama, as tables.

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "builder/augment/view_renderer.h"

namespace panofix {

// Where a direction of the pano frame lies on the panorama: shares of its width [0, 1) and height
// [0, 1] from the left edge and the top edge.
struct PanoramaShare {
  double across = 0, down = 0;
};
[[nodiscard]] PanoramaShare ShareOfDirection(const Eigen::Vector3d& direction_in_pano);

// A depth plane, normal . X = d_m in the pano frame: normal of unit length, away from the panorama.
struct RenderSurface {
  Eigen::Vector3d normal_in_pano;
  double d_m = 0;  // above 0
  int plane_idx = 0;
  // Points round its outline, half a depth pixel outside; those that lie too far or off the plane
  // are drawn in along their ray.
  std::vector<Eigen::Vector3f> outline_in_pano;
};

// One level of the image pyramid. The first column is repeated at the right and the last row below,
// so that bilinear samples need no wrapping.
struct PyramidLevel {
  int width_px = 0, height_px = 0;   // without the repeated ones
  double x_scale = 1, y_scale = 1;   // of full-size pixels
  std::vector<std::uint8_t> padded;  // (width + 1) x (height + 1)
  // At continuous coordinates, pixel edges at whole numbers; x is wrapped, y clamped.
  [[nodiscard]] float Sample(float x, float y) const;
};

struct RenderSource::Impl {
  Impl(const GrayImage& panorama, const GrayImage& mask, DepthMap depth);

  // Surface of a direction: 1-based index into `surfaces`; 0 = nothing known, or masked.
  [[nodiscard]] int SurfaceAt(const PanoramaShare& share) const;
  // Surfaces of the four depth pixels nearest to a direction.
  [[nodiscard]] std::array<int, 4> SurfacesAround(const PanoramaShare& share) const;

  DepthMap depth;
  std::vector<PyramidLevel> levels;            // full size, half, quarter, eighth
  std::vector<RenderSurface> surfaces;         // none without plane-coded depth
  std::vector<std::uint8_t> surface_of_pixel;  // of the depth map's pixels

 private:
  void FindSurfaces(const GrayImage& mask);
  void FindOutlines();
};

inline float PyramidLevel::Sample(float x, float y) const {
  const auto width = static_cast<float>(width_px);
  x -= 0.5F, y -= 0.5F;
  if (x < 0) x += width;
  if (x >= width) x -= width;
  y = std::clamp(y, 0.0F, static_cast<float>(height_px - 1));
  const int left = std::min(static_cast<int>(x), width_px - 1), top = static_cast<int>(y);
  const float fx = x - static_cast<float>(left), fy = y - static_cast<float>(top);
  const std::size_t stride = static_cast<std::size_t>(width_px) + 1;
  const std::uint8_t* above =
      padded.data() + static_cast<std::size_t>(top) * stride + static_cast<std::size_t>(left);
  const std::uint8_t* below = above + stride;
  const float upper = above[0] + fx * static_cast<float>(above[1] - above[0]);
  const float lower = below[0] + fx * static_cast<float>(below[1] - below[0]);
  return upper + fy * (lower - upper);
}

}  // namespace panofix
