#pragma once
// Sources, stations and views of the test street, shared by the renderer's tests.

#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "common/geometry/attitude.h"
#include "tests/builder/augment/plane_world.h"

namespace panofix {

inline Camera ViewCamera() { return Camera::FromHorizontalFov(320, 240, 70); }
inline std::vector<ViewDirection> ViewDirections() { return RingOfViews(6, 0); }

inline Rigid3 WorldFromPano(double x, double y, double heading_deg) {
  return {EnuFromBody({heading_deg, 1, -2}), Eigen::Vector3d(x, y, 0)};
}

// Two panoramas 11 m apart, turned differently, of one world.
struct Street {
  PlaneWorld world;
  std::array<Rigid3, 2> world_from_pano = {WorldFromPano(0, 0, 10), WorldFromPano(-0.5, 11, -25)};
  std::vector<RenderSource> sources;

  explicit Street(PlaneWorld given) : world(std::move(given)) {
    for (const Rigid3& pose : world_from_pano) sources.push_back(world.Source(pose));
  }
  [[nodiscard]] RenderedView Render(const Rigid3& world_from_station, int view_idx,
                                    const RenderOptions& options = {}) const {
    std::vector<const RenderSource*> pointers;
    std::vector<Rigid3> poses;
    for (std::size_t i = 0; i < sources.size(); ++i) {
      pointers.push_back(&sources[i]);
      poses.push_back(world_from_station.Inverse() * world_from_pano[i]);
    }
    return ViewRenderer(ViewCamera(), ViewDirections(), options).Render(pointers, poses, view_idx);
  }
};

// Built once: panoramas take a while to cast.
inline const Street& KioskStreet() {
  static const Street street(PlaneWorld::StreetWithKiosk());
  return street;
}
inline const Street& EmptyStreet() {
  static const Street street(PlaneWorld::Street());
  return street;
}
// Between the two panoramas, 1.8 m beside their line.
inline Rigid3 StationPose() { return WorldFromPano(1.5, 5, 10); }

// Unit ray of a view's pixel in the world.
inline Eigen::Vector3d RayInWorld(const Rigid3& world_from_station, int view_idx, double x,
                                  double y) {
  const Eigen::Vector2d xy = ViewCamera().Normalize({x, y});
  return (world_from_station.rotation *
          (PanoFromCam(ViewDirections()[static_cast<std::size_t>(view_idx)]) *
           Eigen::Vector3d(xy.x(), xy.y(), 1)))
      .normalized();
}

// Calls visit(x, y) on every `step`-th pixel of every `step`-th row.
template <typename Visit>
void ForPixels(int step, const Visit& visit) {
  const Camera camera = ViewCamera();
  for (int y = 0; y < camera.height_px; y += step) {
    for (int x = 0; x < camera.width_px; x += step) visit(x, y);
  }
}

inline int GreyAt(const GrayImage& image, int x, int y) {
  return image.pixels[static_cast<std::size_t>(y * image.width_px + x)];
}

}  // namespace panofix
