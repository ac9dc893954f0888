#pragma once
// Which surface of which source a view's pixel shows.

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "builder/augment/render_source.h"

namespace panofix {

// A source as the view sees it.
struct SourceInView {
  const RenderSource::Impl* source = nullptr;
  Eigen::Matrix3d source_from_cam;
  Eigen::Vector3d cam_in_source;  // the station, metres
};

// A surface as the view sees it, normal . X = offset_m in cam.
struct SurfaceInView {
  Eigen::Vector3d normal_in_cam;
  double offset_m = 0;  // below 0: the station is behind it, and it hides but is not shown
  int source_idx = 0, surface = 0;  // 0-based into the source's surfaces
  // z-depth along a ray of z = 1; not above 0 where the ray does not meet the plane.
  [[nodiscard]] double Depth(const Eigen::Vector3d& ray_in_cam) const {
    return offset_m / normal_in_cam.dot(ray_in_cam);
  }
};

// Label of a pixel: 1-based index into the caster's surfaces; 0 = shows nothing.
using SurfaceLabel = std::uint16_t;

// Casts the rays of one view. Holds working memory: one caster a thread.
class SurfaceCaster {
 public:
  SurfaceCaster(std::span<const RenderSource* const> sources,
                std::span<const Rigid3> station_from_source,
                const Eigen::Matrix3d& station_from_cam, const Camera& camera,
                const RenderOptions& options);

  // What pixel (x, y) shows; pixels up to a tile outside the view are as good.
  [[nodiscard]] SurfaceLabel Cast(int x, int y);
  [[nodiscard]] Eigen::Vector3d Ray(double x, double y) const {
    return {(x - camera_.cx_px) / camera_.fx_px, (y - camera_.cy_px) / camera_.fy_px, 1};
  }
  [[nodiscard]] const std::vector<SourceInView>& sources() const { return sources_; }
  [[nodiscard]] const std::vector<SurfaceInView>& surfaces() const { return surfaces_; }

 private:
  enum class Match { kNone, kNear, kExact };
  struct Hit {
    double range_m = 0;
    int surface = 0;  // into surfaces_
  };
  struct Choice {
    Hit hit;
    Match match = Match::kNone;
  };
  void AddSurfaces(int source_idx);
  void AddToTiles(const RenderSurface& surface, const SourceInView& view, std::uint16_t idx);
  void CollectHits(int x, int y, const Eigen::Vector3d& ray, double ray_length);
  [[nodiscard]] bool IsHidden(const Hit& hit, const Eigen::Vector3d& sight) const;
  [[nodiscard]] Match MatchAt(const SurfaceInView& surface, const Eigen::Vector3d& ray) const;
  // Blow-up of the source's pixels at the hit; nullopt where the source cannot be used there.
  [[nodiscard]] std::optional<double> Stretch(const Hit& hit, const Eigen::Vector3d& ray,
                                              double ray_length) const;

  Camera camera_;
  RenderOptions options_;
  double min_cosine_, min_parallel_;  // of the incidence; between normals of one surface
  std::vector<SourceInView> sources_;
  std::vector<SurfaceInView> surfaces_;
  int tiles_across_ = 0, tiles_down_ = 0;
  std::vector<std::vector<std::uint16_t>> surfaces_of_tile_;
  std::vector<Hit> hits_;        // of the ray at hand, nearest first
  std::vector<Choice> choices_;  // the same, one a source
};

}  // namespace panofix
