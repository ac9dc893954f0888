#pragma once
// Inside a RenderedView: a label a pixel, and what the labels stand for.

#include <vector>

#include "builder/augment/surface_caster.h"

namespace panofix {

struct RenderedView::Impl {
  // Everything here is copied from the caster, whose sources may be gone when points are asked for.
  struct Surface {
    SurfaceInView in_view;
    int plane_idx = 0;
    Eigen::Matrix3d source_from_cam;
    Eigen::Vector3d cam_in_source;
    double rad_per_px = 0;  // of the source's pixels
  };
  Impl(const SurfaceCaster& caster, const Camera& camera);

  [[nodiscard]] Eigen::Vector3d Ray(const Eigen::Vector2d& px) const {
    return {(px.x() - camera.cx_px) / camera.fx_px, (px.y() - camera.cy_px) / camera.fy_px, 1};
  }
  [[nodiscard]] std::size_t Index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(camera.width_px) +
           static_cast<std::size_t>(x);
  }
  // Label of the pixel that a point falls in; nullopt outside the view.
  [[nodiscard]] std::optional<SurfaceLabel> LabelAt(const Eigen::Vector2d& px) const;
  // Whether two neighbouring points show one source and, going from one to the other, no depth
  // step.
  [[nodiscard]] bool AreJoined(SurfaceLabel a_label, const Eigen::Vector2d& a, SurfaceLabel b_label,
                               const Eigen::Vector2d& b) const;

  Camera camera;
  std::vector<Surface> surfaces;     // label - 1
  std::vector<SurfaceLabel> labels;  // row-major, one a pixel
};

}  // namespace panofix
