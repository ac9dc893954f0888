#pragma once
// Depth maps of simple worlds, as the .gsv text that a builder reads.

#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "builder/ingest/depth_map.h"
#include "tests/builder/ingest/gsv_writer.h"

namespace panofix {

inline constexpr int kDepthWidth = 512, kDepthHeight = 256;

// Unit ray through a depth pixel's centre (INTERFACES: column 0 is heading - 180 degrees).
inline Eigen::Vector3d DepthRay(int column, int row) {
  const double azimuth = ((column + 0.5) / kDepthWidth - 0.5) * 2 * M_PI;
  const double elevation = (0.5 - (row + 0.5) / kDepthHeight) * M_PI;
  return {std::cos(elevation) * std::sin(azimuth), std::cos(elevation) * std::cos(azimuth),
          std::sin(elevation)};
}

// .gsv text of planes 1.. chosen by `plane_of` for each pixel's ray; 0 is no surface.
inline std::string GsvText(const std::vector<TestPlane>& planes,
                           const std::function<int(const Eigen::Vector3d&)>& plane_of) {
  std::vector<TestPlane> all{{}};
  all.insert(all.end(), planes.begin(), planes.end());
  std::vector<std::uint8_t> plane_idx;
  for (int row = 0; row < kDepthHeight; ++row) {
    for (int column = 0; column < kDepthWidth; ++column) {
      plane_idx.push_back(static_cast<std::uint8_t>(plane_of(DepthRay(column, row))));
    }
  }
  return Base64(ZlibCompressed(GsvPayload(kDepthWidth, kDepthHeight, all, plane_idx)));
}

// A room: walls 6 m right and 7 m left, 9 m ahead, 11 m behind, the ground 2.5 m down, open sky
// above the walls' 4 m.
struct Room {
  static std::vector<TestPlane> Planes() {
    return {{1, 0, 0, 6}, {-1, 0, 0, 7}, {0, 1, 0, 9}, {0, -1, 0, 11}, {0, 0, -1, 2.5}};
  }
  // Index of the nearest plane along a ray, 0 for the sky, and its range.
  static int Nearest(const Eigen::Vector3d& ray, double* range_m) {
    int best = 0;
    *range_m = 1e9;
    const std::vector<TestPlane> planes = Planes();
    for (std::size_t i = 0; i < planes.size(); ++i) {
      const double cosine = ray.dot(
          Eigen::Vector3d(double{planes[i].nx}, double{planes[i].ny}, double{planes[i].nz}));
      const double range = double{planes[i].d_m} / cosine;
      if (cosine > 1e-9 && range < *range_m) *range_m = range, best = static_cast<int>(i) + 1;
    }
    return *range_m * ray.z() > 4 ? 0 : best;
  }
  static std::string Gsv() {
    return GsvText(Planes(), [](const Eigen::Vector3d& ray) {
      double range_m;
      return Nearest(ray, &range_m);
    });
  }
};

}  // namespace panofix
