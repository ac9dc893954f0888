#pragma once
// A street of flat pieces with a smooth texture: panoramas, depth and views of it by casting rays.

#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "builder/augment/view_renderer.h"
#include "common/geometry/rigid3.h"
#include "tests/builder/extract/box_world.h"

namespace panofix {

// A rectangle: centre +- u +- v, world metres.
struct Patch {
  Eigen::Vector3d centre, u, v;
  [[nodiscard]] Eigen::Vector3d Normal() const { return u.cross(v).normalized(); }
};

struct WorldHit {
  int patch = 0;
  double range_m = 0;
  Eigen::Vector3d point_in_world;
};

class PlaneWorld {
 public:
  // Walls 6 m left and right of the y axis, ground 2.5 m down, an end wall at y = 25.
  static PlaneWorld Street() {
    PlaneWorld world;
    world.Add({{6, 0, 2}, {0, 40, 0}, {0, 0, 4.5}});
    world.Add({{-6, 0, 2}, {0, 40, 0}, {0, 0, 4.5}});
    world.Add({{0, 0, -2.5}, {6, 0, 0}, {0, 40, 0}});
    world.Add({{0, 25, 2}, {6, 0, 0}, {0, 0, 4.5}});
    return world;
  }
  // The same with a kiosk at the right: x 3..5, y 7..10, up to z = 0.5.
  static PlaneWorld StreetWithKiosk() {
    PlaneWorld world = Street();
    for (const double y : {7.0, 10.0}) world.Add({{4, y, -1}, {1, 0, 0}, {0, 0, 1.5}});
    for (const double x : {3.0, 5.0}) world.Add({{x, 8.5, -1}, {0, 1.5, 0}, {0, 0, 1.5}});
    return world;
  }
  void Add(const Patch& patch) { patches_.push_back(patch); }
  static constexpr int kFirstKioskPatch = 4;
  [[nodiscard]] const std::vector<Patch>& patches() const { return patches_; }

  [[nodiscard]] std::optional<WorldHit> Cast(const Eigen::Vector3d& from,
                                             const Eigen::Vector3d& ray) const {
    std::optional<WorldHit> best;
    for (std::size_t i = 0; i < patches_.size(); ++i) {
      const Patch& patch = patches_[i];
      const double range = patch.Normal().dot(patch.centre - from) / patch.Normal().dot(ray);
      if (!(range > 1e-6) || (best && range >= best->range_m)) continue;
      const Eigen::Vector3d point = from + range * ray, offset = point - patch.centre;
      if (std::abs(offset.dot(patch.u)) > patch.u.squaredNorm() ||
          std::abs(offset.dot(patch.v)) > patch.v.squaredNorm()) {
        continue;
      }
      best = {static_cast<int>(i), range, point};
    }
    return best;
  }

  // Waves of about 1.5 m in every direction: no texture finer than a panorama pixel.
  static double Grey(const Eigen::Vector3d& p) {
    return 128 + 50 * std::sin(4.1 * p.x() + 2.9 * p.y() + 1) * std::cos(3.7 * p.z() - p.y()) +
           40 * std::sin(1.3 * p.y() + 0.7 * p.z() + 2.2 * p.x());
  }

  [[nodiscard]] GrayImage Panorama(const Rigid3& world_from_pano, int width_px) const {
    GrayImage image{width_px, width_px / 2, {}};
    for (int row = 0; row < image.height_px; ++row) {
      for (int column = 0; column < width_px; ++column) {
        const double azimuth = ((column + 0.5) / width_px - 0.5) * 2 * M_PI;
        const double elevation = (0.5 - (row + 0.5) / image.height_px) * M_PI;
        const Eigen::Vector3d ray(std::cos(elevation) * std::sin(azimuth),
                                  std::cos(elevation) * std::cos(azimuth), std::sin(elevation));
        const auto hit = Cast(world_from_pano.translation, world_from_pano.rotation * ray);
        image.pixels.push_back(
            hit ? static_cast<std::uint8_t>(std::lround(Grey(hit->point_in_world))) : 255);
      }
    }
    return image;
  }

  // Plane-coded depth: a patch is a plane, its index one more.
  [[nodiscard]] DepthMap Depth(const Rigid3& world_from_pano) const {
    std::vector<TestPlane> planes;
    for (const Patch& patch : patches_) {
      const Eigen::Vector3d n = world_from_pano.rotation.conjugate() * patch.Normal();
      const double d_m = patch.Normal().dot(patch.centre - world_from_pano.translation);
      planes.push_back({static_cast<float>(n.x()), static_cast<float>(n.y()),
                        static_cast<float>(n.z()), static_cast<float>(d_m)});
    }
    const std::string text = GsvText(planes, [&](const Eigen::Vector3d& ray) {
      const auto hit = Cast(world_from_pano.translation, world_from_pano.rotation * ray);
      return hit ? hit->patch + 1 : 0;
    });
    return DepthMap::DecodeGsv(text).value();
  }

  [[nodiscard]] RenderSource Source(const Rigid3& world_from_pano, GrayImage mask = {}) const {
    constexpr int kWidth_px = 1600;
    return RenderSource(Panorama(world_from_pano, kWidth_px), std::move(mask),
                        Depth(world_from_pano));
  }

 private:
  std::vector<Patch> patches_;
};

}  // namespace panofix
