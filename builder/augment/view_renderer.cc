#include "builder/augment/view_renderer.h"

#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include "builder/augment/hole_filler.h"
#include "builder/augment/rendered_view.h"
#include "builder/augment/view_painter.h"
#include "common/base/log.h"

namespace panofix {
namespace {

void Require(bool ok, const char* field, double value, const char* rule) {
  if (!ok) {
    throw std::invalid_argument("RenderOptions." + std::string(field) + " = " +
                                std::to_string(value) + ": must be " + rule);
  }
}

}  // namespace

void RenderOptions::Check() const {
  Require(std::isfinite(max_stretch) && max_stretch >= 1, "max_stretch", max_stretch, "at least 1");
  Require(good_stretch >= 0 && good_stretch <= max_stretch, "good_stretch", good_stretch,
          "within 0..max_stretch");
  Require(max_incidence_deg > 0 && max_incidence_deg < 90, "max_incidence_deg", max_incidence_deg,
          "above 0 and below 90");
  Require(max_range_m > 0 && max_range_m <= 500, "max_range_m", max_range_m,
          "above 0, at most 500");
}

ViewRenderer::ViewRenderer(const Camera& view_camera, std::vector<ViewDirection> directions,
                           const RenderOptions& options)
    : camera_(view_camera), directions_(std::move(directions)), options_(options) {
  options.Check();
  if (const Status status = view_camera.Check(); !status.ok()) {
    throw std::invalid_argument("view camera: " + status.message());
  }
  if (view_camera.HasDistortion()) {
    throw std::invalid_argument("view camera has distortion; use Camera::WithoutDistortion()");
  }
}

RenderedView ViewRenderer::Render(std::span<const RenderSource* const> sources,
                                  std::span<const Rigid3> station_from_source, int view_idx) const {
  if (sources.size() != station_from_source.size()) {
    throw std::invalid_argument(Format("%zu sources, %zu poses; give one pose a source",
                                       sources.size(), station_from_source.size()));
  }
  const Eigen::Matrix3d station_from_cam =
      PanoFromCam(directions_.at(static_cast<std::size_t>(view_idx)));
  SurfaceCaster caster(sources, station_from_source, station_from_cam, camera_, options_);
  const auto view = std::make_shared<RenderedView::Impl>(caster, camera_);
  RenderedView rendered;
  rendered.image = PaintView(caster, camera_, view->labels);
  FillHoles(view->labels, rendered.image);
  rendered.impl = view;
  return rendered;
}

}  // namespace panofix
