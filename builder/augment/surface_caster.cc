#include "builder/augment/surface_caster.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/geometry/attitude.h"

namespace panofix {
namespace {

constexpr int kTile_px = 32;
// Surfaces nearer than this to the station come from depth errors or from inside something solid.
constexpr double kMinRange_m = 0.3;
// The sources' planes of one surface differ by their errors: so much deeper is not hidden.
constexpr double kNotHiddenShare = 0.04, kNotHidden_m = 0.15;
// At a slant small errors go a long way: planes so close and so parallel are one surface, however
// far apart along the ray. The share is of the sources' range, for the error of their normals.
constexpr double kSameSurfaceShare = 0.02, kSameSurface_m = 0.3, kMaxTurn_deg = 5;
// Surfaces that meet: the depth map's outlines are stairs, so near a meeting edge either will do.
constexpr double kMeetingShare = 0.02;
// A less preferred source must gain so much to be worth a seam.
constexpr double kClearlyFiner = 0.8;
// Outline points nearer to the image plane than this may project anywhere.
constexpr double kMinOutlineDepth_m = 0.05;

}  // namespace

SurfaceCaster::SurfaceCaster(std::span<const RenderSource* const> sources,
                             std::span<const Rigid3> station_from_source,
                             const Eigen::Matrix3d& station_from_cam, const Camera& camera,
                             const RenderOptions& options)
    : camera_(camera),
      options_(options),
      min_cosine_(std::cos(options.max_incidence_deg * kRadPerDeg)),
      min_parallel_(std::cos(kMaxTurn_deg * kRadPerDeg)),
      // A tile more each way: blocks end outside the view.
      tiles_across_(camera.width_px / kTile_px + 2),
      tiles_down_(camera.height_px / kTile_px + 2) {
  surfaces_of_tile_.resize(static_cast<std::size_t>(tiles_across_) *
                           static_cast<std::size_t>(tiles_down_));
  for (std::size_t i = 0; i < sources.size(); ++i) {
    const Rigid3 source_from_station = station_from_source[i].Inverse();
    sources_.push_back({&sources[i]->impl(),
                        source_from_station.rotation.toRotationMatrix() * station_from_cam,
                        source_from_station.translation});
    AddSurfaces(static_cast<int>(i));
  }
  choices_.resize(sources_.size());
}

void SurfaceCaster::AddSurfaces(int source_idx) {
  const SourceInView& view = sources_[static_cast<std::size_t>(source_idx)];
  for (std::size_t s = 0; s < view.source->surfaces.size(); ++s) {
    const RenderSurface& surface = view.source->surfaces[s];
    surfaces_.push_back({view.source_from_cam.transpose() * surface.normal_in_pano,
                         surface.d_m - surface.normal_in_pano.dot(view.cam_in_source), source_idx,
                         static_cast<int>(s)});
    AddToTiles(surface, view, static_cast<std::uint16_t>(surfaces_.size() - 1));
  }
}

// A piece of a plane in front of the camera projects into the hull of its outline's projection.
void SurfaceCaster::AddToTiles(const RenderSurface& surface, const SourceInView& view,
                               std::uint16_t idx) {
  const double inf = std::numeric_limits<double>::infinity();
  double left = inf, right = -inf, top = inf, bottom = -inf;
  bool any_behind = false, any_before = false;
  for (const Eigen::Vector3f& point : surface.outline_in_pano) {
    const Eigen::Vector3d x_in_cam =
        view.source_from_cam.transpose() * (point.cast<double>() - view.cam_in_source);
    if (x_in_cam.z() < kMinOutlineDepth_m) {
      any_behind = true;
      continue;
    }
    any_before = true;
    const double x = camera_.fx_px * x_in_cam.x() / x_in_cam.z() + camera_.cx_px;
    const double y = camera_.fy_px * x_in_cam.y() / x_in_cam.z() + camera_.cy_px;
    left = std::min(left, x), right = std::max(right, x);
    top = std::min(top, y), bottom = std::max(bottom, y);
  }
  if (!any_before) return;
  if (any_behind) left = top = -inf, right = bottom = inf;
  const auto tile = [](double px, int count) {
    return static_cast<int>(std::clamp(std::floor(px / kTile_px), -1.0, double{1} * count));
  };
  const int last_column = std::min(tile(right, tiles_across_), tiles_across_ - 1);
  const int last_row = std::min(tile(bottom, tiles_down_), tiles_down_ - 1);
  for (int row = std::max(tile(top, tiles_down_), 0); row <= last_row; ++row) {
    for (int column = std::max(tile(left, tiles_across_), 0); column <= last_column; ++column) {
      surfaces_of_tile_[static_cast<std::size_t>(row * tiles_across_ + column)].push_back(idx);
    }
  }
}

void SurfaceCaster::CollectHits(int x, int y, const Eigen::Vector3d& ray, double ray_length) {
  hits_.clear();
  const auto tile = static_cast<std::size_t>(y / kTile_px * tiles_across_ + x / kTile_px);
  for (const std::uint16_t idx : surfaces_of_tile_[tile]) {
    const double range_m = surfaces_[idx].Depth(ray) * ray_length;
    if (range_m > kMinRange_m && range_m <= options_.max_range_m) hits_.push_back({range_m, idx});
  }
  std::sort(hits_.begin(), hits_.end(), [](const Hit& a, const Hit& b) {
    return a.range_m != b.range_m ? a.range_m < b.range_m : a.surface < b.surface;
  });
}

// Whether the surface of a source at hand hides the hit.
bool SurfaceCaster::IsHidden(const Hit& hit, const Eigen::Vector3d& sight) const {
  const SurfaceInView& surface = surfaces_[static_cast<std::size_t>(hit.surface)];
  const Eigen::Vector3d x_in_cam = hit.range_m * sight;
  for (const Choice& choice : choices_) {
    if (choice.match == Match::kNone ||
        hit.range_m <= choice.hit.range_m * (1 + kNotHiddenShare) + kNotHidden_m) {
      continue;
    }
    const SurfaceInView& before = surfaces_[static_cast<std::size_t>(choice.hit.surface)];
    const auto source_range_m = [&](const SurfaceInView& s) {
      const SourceInView& view = sources_[static_cast<std::size_t>(s.source_idx)];
      return (view.cam_in_source + view.source_from_cam * x_in_cam).norm();
    };
    const bool is_same = surface.normal_in_cam.dot(before.normal_in_cam) > min_parallel_ &&
                         std::abs(before.normal_in_cam.dot(x_in_cam) - before.offset_m) <
                             kSameSurface_m + kSameSurfaceShare * std::max(source_range_m(surface),
                                                                           source_range_m(before));
    if (!is_same) return true;
  }
  return false;
}

SurfaceCaster::Match SurfaceCaster::MatchAt(const SurfaceInView& surface,
                                            const Eigen::Vector3d& ray) const {
  const SourceInView& view = sources_[static_cast<std::size_t>(surface.source_idx)];
  const Eigen::Vector3d x_in_source =
      view.cam_in_source + surface.Depth(ray) * (view.source_from_cam * ray);
  const PanoramaShare share = ShareOfDirection(x_in_source);
  const int seen = view.source->SurfaceAt(share), own = surface.surface + 1;
  if (seen == own) return Match::kExact;
  if (seen == 0) return Match::kNone;
  const RenderSurface& other = view.source->surfaces[static_cast<std::size_t>(seen - 1)];
  // 1 where the source sees the other surface just as far as this one.
  const double ratio = other.normal_in_pano.dot(x_in_source) / other.d_m;
  if (!(std::abs(ratio - 1) < kMeetingShare)) return Match::kNone;
  const std::array<int, 4> around = view.source->SurfacesAround(share);
  return std::find(around.begin(), around.end(), own) != around.end() ? Match::kNear : Match::kNone;
}

std::optional<double> SurfaceCaster::Stretch(const Hit& hit, const Eigen::Vector3d& ray,
                                             double ray_length) const {
  const SurfaceInView& surface = surfaces_[static_cast<std::size_t>(hit.surface)];
  const SourceInView& view = sources_[static_cast<std::size_t>(surface.source_idx)];
  const Eigen::Vector3d sight = view.source_from_cam * (ray / ray_length);  // of the station
  const Eigen::Vector3d x_in_source = view.cam_in_source + hit.range_m * sight;
  const double source_range_m = x_in_source.norm();
  if (!(source_range_m <= options_.max_range_m)) return std::nullopt;
  const Eigen::Vector3d source_sight = x_in_source / source_range_m;
  const Eigen::Vector3d& normal =
      view.source->surfaces[static_cast<std::size_t>(surface.surface)].normal_in_pano;
  const double cosine = normal.dot(sight), source_cosine = normal.dot(source_sight);
  // A surface's back is hit against its normal, so it falls here too.
  if (cosine < min_cosine_ || source_cosine < min_cosine_) return std::nullopt;
  // A turn of the station's sight by a radian moves the point on the plane by range / cosine along
  // the tilt and by range across it; the source sees these moves across its own sight.
  const Eigen::Vector3d across = normal.cross(sight);
  const double sine = across.norm();
  const Eigen::Vector3d b = sine > 1e-9 ? Eigen::Vector3d(across / sine) : normal.unitOrthogonal();
  const Eigen::Vector3d a = b.cross(normal);
  const double a_along = a.dot(source_sight), b_along = b.dot(source_sight);
  const double aa = (1 - a_along * a_along) / (cosine * cosine);
  const double bb = 1 - b_along * b_along, ab = -a_along * b_along / cosine;
  const double mean = (aa + bb) / 2;
  const double smallest = mean - std::sqrt((aa - bb) * (aa - bb) / 4 + ab * ab);
  if (!(smallest > 0)) return std::nullopt;
  return source_range_m / (hit.range_m * std::sqrt(smallest));
}

SurfaceLabel SurfaceCaster::Cast(int x, int y) {
  const Eigen::Vector3d ray = Ray(x, y);
  const double ray_length = ray.norm();
  CollectHits(x, y, ray, ray_length);
  for (Choice& choice : choices_) choice.match = Match::kNone;
  for (const Hit& hit : hits_) {
    const SurfaceInView& surface = surfaces_[static_cast<std::size_t>(hit.surface)];
    Choice& choice = choices_[static_cast<std::size_t>(surface.source_idx)];
    if (choice.match == Match::kExact || IsHidden(hit, ray / ray_length)) continue;
    const Match match = MatchAt(surface, ray);
    if (match == Match::kNone || match == choice.match) continue;
    choice = {hit, match};
  }
  double best_stretch = std::numeric_limits<double>::infinity();
  SurfaceLabel best = 0;
  for (const Choice& choice : choices_) {
    if (choice.match == Match::kNone) continue;
    const std::optional<double> stretch = Stretch(choice.hit, ray, ray_length);
    if (!stretch || *stretch > options_.max_stretch) continue;
    if (*stretch >= kClearlyFiner * best_stretch) continue;
    best_stretch = *stretch;
    best = static_cast<SurfaceLabel>(choice.hit.surface + 1);
    if (best_stretch <= options_.good_stretch) break;
  }
  return best;
}

}  // namespace panofix
