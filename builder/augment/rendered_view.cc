#include "builder/augment/rendered_view.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace panofix {
namespace {

// Surfaces that differ so little in depth at a pixel are one piece there (cornices, kerbs).
constexpr double kStepShare = 0.05;
constexpr int kNumInner = 8, kNumOuter = 16;

Eigen::Vector2d OnRing(const Eigen::Vector2d& centre, double radius_px, int i, int count) {
  const double angle = 2 * std::numbers::pi * i / count;
  return centre + radius_px * Eigen::Vector2d(std::cos(angle), std::sin(angle));
}

}  // namespace

RenderedView::Impl::Impl(const SurfaceCaster& caster, const Camera& view_camera)
    : camera(view_camera) {
  for (const SurfaceInView& in_view : caster.surfaces()) {
    const SourceInView& view = caster.sources()[static_cast<std::size_t>(in_view.source_idx)];
    surfaces.push_back({in_view,
                        view.source->surfaces[static_cast<std::size_t>(in_view.surface)].plane_idx,
                        view.source_from_cam, view.cam_in_source,
                        2 * std::numbers::pi / view.source->levels.front().width_px});
  }
  labels.assign(
      static_cast<std::size_t>(camera.width_px) * static_cast<std::size_t>(camera.height_px), 0);
}

std::optional<SurfaceLabel> RenderedView::Impl::LabelAt(const Eigen::Vector2d& px) const {
  const double x = std::floor(px.x() + 0.5), y = std::floor(px.y() + 0.5);
  // The negation also catches NaN.
  if (!(x >= 0 && x < camera.width_px && y >= 0 && y < camera.height_px)) return std::nullopt;
  return labels[Index(static_cast<int>(x), static_cast<int>(y))];
}

bool RenderedView::Impl::AreJoined(SurfaceLabel a_label, const Eigen::Vector2d& a,
                                   SurfaceLabel b_label, const Eigen::Vector2d& b) const {
  if (a_label == 0 || b_label == 0) return false;
  if (a_label == b_label) return true;
  const SurfaceInView& first = surfaces[a_label - std::size_t{1}].in_view;
  const SurfaceInView& second = surfaces[b_label - std::size_t{1}].in_view;
  if (first.source_idx != second.source_idx) return false;
  const Eigen::Vector3d a_ray = Ray(a), b_ray = Ray(b);
  const double a_step = first.Depth(a_ray) / second.Depth(a_ray) - 1;
  const double b_step = first.Depth(b_ray) / second.Depth(b_ray) - 1;
  // They meet between the two points where the step changes sign (planes that turn behind the
  // camera give less than -1, and meet nowhere).
  if (a_step > -1 && b_step > -1 && a_step * b_step <= 0) return true;
  return std::min(std::abs(a_step), std::abs(b_step)) <= kStepShare;
}

std::optional<RenderedPoint> RenderedView::At(const Eigen::Vector2d& px) const {
  const SurfaceLabel label = impl->LabelAt(px).value_or(0);
  if (label == 0) return std::nullopt;
  const Impl::Surface& surface = impl->surfaces[label - std::size_t{1}];
  const Eigen::Vector3d ray = impl->Ray(px);
  const double depth_m = surface.in_view.Depth(ray);
  if (!(depth_m > 0) || !std::isfinite(depth_m)) return std::nullopt;
  RenderedPoint point;
  point.source_idx = surface.in_view.source_idx;
  point.surface_idx = surface.plane_idx;
  point.point_in_source = surface.cam_in_source + depth_m * (surface.source_from_cam * ray);
  point.metres_per_px = point.point_in_source.norm() * surface.rad_per_px;
  return point;
}

bool RenderedView::IsWhole(const Eigen::Vector2d& px, double radius_px) const {
  struct Sample {
    SurfaceLabel label;
    Eigen::Vector2d px;
  };
  const std::optional<SurfaceLabel> centre_label = impl->LabelAt(px);
  if (centre_label.value_or(0) == 0) return false;
  // What lies outside the view is in no descriptor, so it is taken for the centre's.
  const auto sample = [&](double radius, int i, int count) {
    const Eigen::Vector2d at = OnRing(px, radius, i, count);
    const std::optional<SurfaceLabel> label = impl->LabelAt(at);
    return label ? Sample{*label, at} : Sample{*centre_label, px};
  };
  std::array<Sample, kNumInner> inner;
  std::array<Sample, kNumOuter> outer;
  for (int i = 0; i < kNumInner; ++i) {
    inner[static_cast<std::size_t>(i)] = sample(radius_px / 2, i, kNumInner);
  }
  for (int i = 0; i < kNumOuter; ++i) {
    outer[static_cast<std::size_t>(i)] = sample(radius_px, i, kNumOuter);
  }
  const auto joined = [&](const Sample& a, const Sample& b) {
    return impl->AreJoined(a.label, a.px, b.label, b.px);
  };
  const Sample centre{*centre_label, px};
  for (std::size_t i = 0; i < kNumInner; ++i) {
    if (!joined(centre, inner[i]) || !joined(inner[i], inner[(i + 1) % kNumInner])) return false;
  }
  for (std::size_t i = 0; i < kNumOuter; ++i) {
    if (!joined(outer[i], inner[i * kNumInner / kNumOuter]) ||
        !joined(outer[i], outer[(i + 1) % kNumOuter])) {
      return false;
    }
  }
  return true;
}

double RenderedView::coverage() const {
  if (impl->labels.empty()) return 0;
  const auto num_holes = std::count(impl->labels.begin(), impl->labels.end(), SurfaceLabel{0});
  return 1 - static_cast<double>(num_holes) / static_cast<double>(impl->labels.size());
}

}  // namespace panofix
