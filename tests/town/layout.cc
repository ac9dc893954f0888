#include "tests/town/layout.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "common/base/log.h"
#include "common/base/rng.h"
#include "common/geometry/attitude.h"

namespace panofix::town {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kOuterMargin_m = 40;  // of ground beyond the last street
constexpr double kCornerRadius_m = 6;  // of a vehicle's turn
constexpr double kRouteMargin_m = 9;   // before the first panorama and after the last
constexpr double kTrackOffset_m =
    -0.4;  // of the panoramas' track from the street's centre, rightwards

double Interpolate(const std::vector<double>& knots, const std::vector<double>& values, double x) {
  const auto upper = std::upper_bound(knots.begin() + 1, knots.end() - 1, x);
  const auto i = static_cast<std::size_t>(upper - knots.begin());
  const double share = (x - knots[i - 1]) / (knots[i] - knots[i - 1]);
  return values[i - 1] + share * (values[i] - values[i - 1]);
}

// Knots at both edges of each street; steeper between the streets than across them.
void PlanHeights(const std::vector<double>& lines, const std::vector<double>& half_widths,
                 double slope, Rng& rng, std::vector<double>& knots, std::vector<double>& heights) {
  knots = {lines.front() - kOuterMargin_m};
  for (std::size_t i = 0; i < lines.size(); ++i) {
    knots.push_back(lines[i] - half_widths[i]);
    knots.push_back(lines[i] + half_widths[i]);
  }
  knots.push_back(lines.back() + kOuterMargin_m);
  heights = {0};
  for (std::size_t i = 1; i < knots.size(); ++i) {
    const bool across = i % 2 == 0;
    const double sign = rng.Uniform() < 0.6 ? 1 : -1;
    const double grade = slope * (across ? rng.Uniform(-0.5, 0.5) : sign * rng.Uniform(0.7, 1.2));
    heights.push_back(heights.back() + grade * (knots[i] - knots[i - 1]));
  }
}

StreetGrid PlanGrid(const TownOptions& options, double block_m, int num_x, int num_y) {
  Rng rng(options.seed, "town/grid");
  StreetGrid grid;
  const auto lines = [&](int count, std::vector<double>& at, std::vector<double>& half_widths) {
    double position = 0;
    for (int i = 0; i < count; ++i) {
      at.push_back(position);
      half_widths.push_back(rng.Uniform(6.8, 8.0));
      position += block_m * rng.Uniform(0.92, 1.1);
    }
  };
  lines(num_x, grid.x_lines_m, grid.x_half_widths_m);
  lines(num_y, grid.y_lines_m, grid.y_half_widths_m);
  PlanHeights(grid.x_lines_m, grid.x_half_widths_m, options.slope, rng, grid.x_knots_m,
              grid.x_heights_m);
  PlanHeights(grid.y_lines_m, grid.y_half_widths_m, options.slope, rng, grid.y_knots_m,
              grid.y_heights_m);
  const double zero = grid.GroundHeight(grid.x_lines_m[0], grid.y_lines_m[0]);
  for (double& height : grid.x_heights_m) height -= zero;
  return grid;
}

// Body axes on the ground: forward along the street, up along the ground's normal.
Matrix3d BodyOnGround(const StreetGrid& grid, const Route::Place& place) {
  const Vector2d& p = place.position_m;
  const Vector2d& f = place.direction;
  const Vector3d forward = grid.Along(p.x(), p.y(), f.x(), f.y());
  const Vector3d side = grid.Along(p.x(), p.y(), f.y(), -f.x());
  Matrix3d body;
  body.col(1) = forward;
  body.col(2) = side.cross(forward).normalized();
  body.col(0) = body.col(1).cross(body.col(2));
  return body;
}

Vector2d RightOf(const Vector2d& direction) { return {direction.y(), -direction.x()}; }

Rigid3 PlacePanorama(const TownOptions& options, const StreetGrid& grid, const Route::Place& place,
                     int index) {
  Rng rng(options.seed, "town/panorama/" + std::to_string(index));
  const Vector2d at =
      place.position_m + RightOf(place.direction) * (kTrackOffset_m + 0.15 * rng.Normal());
  const double heading_rad =
      std::atan2(place.direction.x(), place.direction.y()) + 2.5 * kRadPerDeg * rng.Normal();
  Attitude attitude{heading_rad / kRadPerDeg, options.tilt_sigma_deg * rng.Normal(),
                    options.tilt_sigma_deg * rng.Normal()};
  return {EnuFromBody(attitude),
          grid.OnGround(at.x(), at.y()) + Vector3d(0, 0, options.panorama_height_m)};
}

FramePose PlaceFrame(const TownOptions& options, const StreetGrid& grid, const Route& route,
                     double arc_m, double wobble_phase, int index) {
  Rng rng(options.seed, "town/frame/" + std::to_string(index));
  const Route::Place place = route.At(arc_m);
  const double wobble_m = 0.3 * std::sin(arc_m / 9.0 + wobble_phase) + 0.04 * rng.Normal();
  const Vector2d at = place.position_m + RightOf(place.direction) *
                                             (kTrackOffset_m + options.lane_offset_m + wobble_m);
  const auto about = [](double deg, const Vector3d& axis) {
    return Eigen::AngleAxisd(deg * kRadPerDeg, axis).toRotationMatrix();
  };
  const double yaw_deg =
      options.camera_yaw_deg + 1.2 * std::cos(arc_m / 9.0 + wobble_phase) + 0.4 * rng.Normal();
  const double pitch_deg = options.camera_pitch_deg + 0.4 * rng.Normal();
  const Matrix3d body = BodyOnGround(grid, {at, place.direction}) *
                        about(-yaw_deg, Vector3d::UnitZ()) * about(pitch_deg, Vector3d::UnitX()) *
                        about(0.5 * rng.Normal(), Vector3d::UnitY());
  FramePose frame;
  const Vector3d position = grid.OnGround(at.x(), at.y()) + Vector3d(0, 0, options.camera_height_m);
  frame.town_from_cam = Rigid3(Matrix3d(body * BodyFromCam()), position);
  return frame;
}

std::string PanoramaId(int index) { return Format("pano-%05d", index); }

void Link(PanoramaPose& a, PanoramaPose& b) {
  if (a.id == b.id || std::find(a.links.begin(), a.links.end(), b.id) != a.links.end()) return;
  a.links.push_back(b.id);
  b.links.push_back(a.id);
}

void AddPanorama(const TownOptions& options, Layout& layout, const Route::Place& place) {
  const int index = static_cast<int>(layout.panoramas.size());
  layout.panoramas.push_back(
      {PanoramaId(index), PlacePanorama(options, layout.grid, place, index), {}});
}

// Two blocks ahead, one to the left, and so on: a corner and a crossing within the first 160 m.
std::vector<Vector2d> Staircase(const StreetGrid& grid) {
  std::vector<Vector2d> nodes;
  std::size_t i = 0, j = 1;
  for (int step = 0; i < grid.x_lines_m.size() && j < grid.y_lines_m.size(); ++step) {
    nodes.emplace_back(grid.x_lines_m[i], grid.y_lines_m[j]);
    (step % 3 == 2 ? j : i) += 1;
  }
  return nodes;
}

Route PlanStreet(const TownOptions& options, Layout& layout) {
  const double mapped_m = (options.num_panoramas - 1) * options.spacing_m;
  const double needed_m = mapped_m + 2 * kRouteMargin_m + 8;
  const double block_m = std::clamp(needed_m / 2.9, 34.0, 75.0);
  const int steps = static_cast<int>(std::ceil(needed_m / (0.9 * block_m))) + 1;
  layout.grid = PlanGrid(options, block_m, 2 + (2 * steps + 2) / 3, 2 + (steps + 1) / 3);
  Route route(Staircase(layout.grid));
  for (int k = 0; k < options.num_panoramas; ++k) {
    AddPanorama(options, layout, route.At(kRouteMargin_m + k * options.spacing_m));
    if (k > 0) Link(layout.panoramas[layout.panoramas.size() - 2], layout.panoramas.back());
  }
  layout.mapped_m = mapped_m;
  return route;
}

// Panoramas on every street but, where frames are to be driven off the map, the last along y.
void MapGrid(const TownOptions& options, Layout& layout) {
  const StreetGrid& grid = layout.grid;
  std::vector<Vector2d> at;
  const auto add_line = [&](const Vector2d& from, const Vector2d& to, bool skip_crossings) {
    const double length_m = (to - from).norm();
    const Vector2d direction = (to - from) / length_m;
    int previous = -1;
    for (double arc_m = 0; arc_m <= length_m; arc_m += options.spacing_m) {
      const Vector2d p = from + arc_m * direction;
      const auto crossing =
          std::find_if(grid.y_lines_m.begin(), grid.y_lines_m.end(),
                       [&](double y) { return std::abs(y - p.y()) < 0.6 * options.spacing_m; });
      if (skip_crossings && crossing != grid.y_lines_m.end()) {
        // The other street's panoramas stand here: link to the nearest of them.
        std::size_t nearest = 0;
        for (std::size_t k = 0; k < at.size(); ++k) {
          if ((at[k] - p).norm() < (at[nearest] - p).norm()) nearest = k;
        }
        auto& poses = layout.panoramas;
        if (previous >= 0) Link(poses[static_cast<std::size_t>(previous)], poses[nearest]);
        previous = static_cast<int>(nearest);
        continue;
      }
      AddPanorama(options, layout, {p, direction});
      at.push_back(p);
      auto& poses = layout.panoramas;
      if (previous >= 0) Link(poses[static_cast<std::size_t>(previous)], poses.back());
      previous = static_cast<int>(poses.size() - 1);
    }
    layout.mapped_m += length_m;
  };
  const double x0 = grid.x_lines_m.front(), x1 = grid.x_lines_m.back();
  const double y0 = grid.y_lines_m.front(), y1 = grid.y_lines_m.back();
  for (const double y : grid.y_lines_m) add_line({x0, y}, {x1, y}, false);
  for (std::size_t i = 0; i + (options.num_off_map_frames > 0 ? 1 : 0) < grid.x_lines_m.size();
       ++i) {
    add_line({grid.x_lines_m[i], y0}, {grid.x_lines_m[i], y1}, true);
  }
}

// A walk over the mapped streets that never turns back.
std::vector<Vector2d> Wander(const TownOptions& options, const StreetGrid& grid, double length_m) {
  Rng rng(options.seed, "town/walk");
  const int num_x = static_cast<int>(grid.x_lines_m.size()) - (options.num_off_map_frames > 0);
  const int num_y = static_cast<int>(grid.y_lines_m.size());
  int i = 0, j = 0, di = 0, dj = 0;
  const auto node = [&](int a, int b) {
    return Vector2d(grid.x_lines_m[static_cast<std::size_t>(a)],
                    grid.y_lines_m[static_cast<std::size_t>(b)]);
  };
  std::vector<Vector2d> nodes{node(0, 0)};
  double walked_m = 0;
  while (walked_m < length_m) {
    constexpr int kSteps[4][2] = {{1, 0}, {0, 1}, {-1, 0}, {0, -1}};
    const auto& step = kSteps[rng.Below(4)];
    const int a = i + step[0], b = j + step[1];
    const bool back = step[0] == -di && step[1] == -dj;
    if (a < 0 || b < 0 || a >= num_x || b >= num_y || back) continue;
    walked_m += (node(a, b) - node(i, j)).norm() - kCornerRadius_m;
    i = a, j = b, di = step[0], dj = step[1];
    nodes.push_back(node(i, j));
  }
  return nodes;
}

void PlanDrive(const TownOptions& options, Layout& layout, const Route& route, double start_m,
               double span_m) {
  Rng rng(options.seed, "town/drive");
  const double phase = rng.Uniform(0, 6.28);
  const int count = options.num_frames;
  double step_m = count > 1 ? span_m / (count - 1) : 0;
  if (options.frame_spacing_m > 0) step_m = options.frame_spacing_m;
  constexpr double kSpeed_mps = 8;
  constexpr std::int64_t kStart_ns = 1'700'000'000'000'000'000;
  constexpr std::int64_t kLeastPeriod_ns = 50'000'000;
  const auto period_ns =
      std::max(kLeastPeriod_ns, static_cast<std::int64_t>(step_m / kSpeed_mps * 1e9));
  for (int k = 0; k < count; ++k) {
    const double arc_m = std::min(start_m + k * step_m, route.length_m());
    layout.frames.push_back(PlaceFrame(options, layout.grid, route, arc_m, phase, k));
  }
  // The street without panoramas: beyond the crossing of the first cross street, or the last
  // street.
  const StreetGrid& grid = layout.grid;
  const bool scale = options.num_blocks > 0;
  const double x = scale ? grid.x_lines_m.back() : grid.x_lines_m[1];
  const double from_y = scale ? grid.y_lines_m.front() + 16 : grid.y_lines_m[1] - 16;
  const double to_y = scale ? grid.y_lines_m.back() - 16 : grid.y_lines_m[0] + 2;
  const Route side({{x, from_y}, {x, to_y}});
  for (int k = 0; k < options.num_off_map_frames; ++k) {
    const double arc_m = side.length_m() * (k + 0.5) / options.num_off_map_frames;
    layout.frames.push_back(PlaceFrame(options, layout.grid, side, arc_m, phase, count + k));
    layout.frames.back().off_map = true;
  }
  for (std::size_t k = 0; k < layout.frames.size(); ++k) {
    layout.frames[k].timestamp_ns = kStart_ns + static_cast<std::int64_t>(k) * period_ns;
  }
}

}  // namespace

double StreetGrid::GroundHeight(double x_m, double y_m) const {
  return Interpolate(x_knots_m, x_heights_m, x_m) + Interpolate(y_knots_m, y_heights_m, y_m);
}

Vector3d StreetGrid::Along(double x_m, double y_m, double dir_x, double dir_y) const {
  constexpr double kStep_m = 0.5;
  const Vector2d d(dir_x * kStep_m, dir_y * kStep_m);
  return (OnGround(x_m + d.x(), y_m + d.y()) - OnGround(x_m - d.x(), y_m - d.y())).normalized();
}

Route::Route(const std::vector<Vector2d>& nodes) {
  constexpr int kArcSteps = 48;
  points_.push_back(nodes.front());
  for (std::size_t i = 1; i + 1 < nodes.size(); ++i) {
    const Vector2d in = (nodes[i] - nodes[i - 1]).normalized();
    const Vector2d out = (nodes[i + 1] - nodes[i]).normalized();
    const double turn = in.x() * out.y() - in.y() * out.x();
    if (std::abs(turn) < 0.5) continue;  // straight on
    const Vector2d centre = nodes[i] + kCornerRadius_m * (out - in);
    for (int k = 0; k <= kArcSteps; ++k) {
      const double angle = 0.5 * std::numbers::pi * k / kArcSteps;
      points_.push_back(centre - kCornerRadius_m * (std::cos(angle) * out - std::sin(angle) * in));
    }
  }
  points_.push_back(nodes.back());
  arcs_m_ = {0};
  for (std::size_t i = 1; i < points_.size(); ++i) {
    arcs_m_.push_back(arcs_m_.back() + (points_[i] - points_[i - 1]).norm());
  }
  length_m_ = arcs_m_.back();
}

Route::Place Route::At(double arc_m) const {
  const double arc = std::clamp(arc_m, 0.0, length_m_);
  auto upper = std::upper_bound(arcs_m_.begin() + 1, arcs_m_.end() - 1, arc);
  const auto i = static_cast<std::size_t>(upper - arcs_m_.begin());
  const Vector2d along = points_[i] - points_[i - 1];
  const double span = std::max(1e-9, arcs_m_[i] - arcs_m_[i - 1]);
  return {points_[i - 1] + along * ((arc - arcs_m_[i - 1]) / span), along.normalized()};
}

Layout PlanLayout(const TownOptions& options) {
  Layout layout;
  if (options.num_blocks == 0) {
    const Route route = PlanStreet(options, layout);
    PlanDrive(options, layout, route, kRouteMargin_m, layout.mapped_m);
    return layout;
  }
  constexpr double kBlock_m = 62;
  layout.grid = PlanGrid(options, kBlock_m, options.num_blocks + 1, options.num_blocks + 1);
  MapGrid(options, layout);
  const double spacing_m = options.frame_spacing_m > 0 ? options.frame_spacing_m : 4.0;
  const double span_m = std::max(0, options.num_frames - 1) * spacing_m;
  const Route route(Wander(options, layout.grid, span_m + 2 * kRouteMargin_m));
  PlanDrive(options, layout, route, kRouteMargin_m, span_m);
  return layout;
}

}  // namespace panofix::town
