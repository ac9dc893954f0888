#include "tests/town/building.h"

#include <Eigen/Geometry>

namespace panofix::town {
namespace {

using Eigen::Vector3d;

// Behind a corner's other front, so that nothing shows through that front's openings.
constexpr double kCornerInset_m = 1.2;
constexpr double kCellar_m = 1.5;  // wall below the lowest ground, so that no slope opens a gap

std::uint32_t AddWindowMaterial(World& world, const FacadeStyle& style, Rng& rng) {
  Material pane;
  pane.kind = MaterialKind::kWindow;
  pane.seed = static_cast<std::uint32_t>(rng());
  pane.a = style.frame_colour;
  pane.b = DrawColour(rng, 0.4, 0.3, 0.9);  // curtain
  pane.width_m = static_cast<float>(style.window_width_m);
  pane.height_m = static_cast<float>(style.window_height_m);
  pane.style = static_cast<int>(rng.Below(5));
  return world.AddMaterial(pane);
}

// A storey of a bay that stands out of the wall, with a wide window of its own.
void AddBow(World& world, const WallFrame& frame, const FacadeStyle& style, double bay_m, double v0,
            Rng& rng) {
  constexpr double kOut_m = 0.55, kMargin_m = 0.15;
  const double width_m = bay_m - 2 * kMargin_m, u0 = style.bow_bay * bay_m + kMargin_m;
  WallFrame front = frame;
  front.origin = frame.At(u0, v0, kOut_m);
  Opening pane{0.25,           width_m - 0.25,
               style.sill_m,   style.sill_m + style.window_height_m,
               style.recess_m, AddWindowMaterial(world, style, rng)};
  world.materials[pane.pane_material].width_m = static_cast<float>(width_m - 0.5);
  AddStorey(world, front, width_m, 0, style.floor_m, {pane}, style.wall, style.reveal);
  const double v1 = v0 + style.floor_m, u1 = u0 + width_m;
  const auto face = [&](double ua, double wa, double ub, double wb) {
    world.AddQuad(frame.At(ua, v0, wa), frame.At(ub, v0, wb), frame.At(ub, v1, wb),
                  frame.At(ua, v1, wa), style.wall, ua, v0);
  };
  face(u0, 0, u0, kOut_m);
  face(u1, kOut_m, u1, 0);
  AddRelief(world, frame, u0 - 0.05, u1 + 0.05, v1 - 0.12, v1, 0, kOut_m + 0.06, style.trim);
  AddRelief(world, frame, u0 - 0.05, u1 + 0.05, v0 - 0.1, v0 + 0.04, 0, kOut_m + 0.06, style.trim);
}

void AddUpperFloors(World& world, const WallFrame& frame, double width_m, const FacadeStyle& style,
                    Rng& rng) {
  const double bay_m = width_m / style.bays;
  for (int floor = 1; floor < style.floors; ++floor) {
    const double v0 = style.ground_floor_m + (floor - 1) * style.floor_m;
    std::vector<Opening> openings;
    for (int bay = 0; bay < style.bays; ++bay) {
      if (bay == style.bow_bay) {
        AddBow(world, frame, style, bay_m, v0, rng);
        continue;
      }
      if (rng.Uniform() < 0.05) continue;  // a walled-up window
      const double scale = rng.Uniform() < 0.1 ? 0.6 : 1.0;
      const double centre = (bay + 0.5) * bay_m;
      Opening opening;
      opening.u0 = centre - 0.5 * scale * style.window_width_m;
      opening.u1 = centre + 0.5 * scale * style.window_width_m;
      opening.v0 = v0 + style.sill_m;
      opening.v1 = opening.v0 + style.window_height_m * (scale < 1 ? 0.7 : 1.0);
      opening.recess_m = style.recess_m;
      opening.pane_material = AddWindowMaterial(world, style, rng);
      openings.push_back(opening);
      const bool balcony = style.balconies && rng.Uniform() < 0.6;
      AddWindowTrim(world, frame, opening, style, balcony, rng);
    }
    AddStorey(world, frame, width_m, v0, v0 + style.floor_m, openings, style.wall, style.reveal);
  }
}

// Ends of the house's body along the front.
struct Body {
  double left_m, right_m;
  Body(const Lot& lot, double width_m)
      : left_m(lot.corner_left ? kCornerInset_m : 0),
        right_m(width_m - (lot.corner_right ? kCornerInset_m : 0)) {}
};

void AddRoof(World& world, const WallFrame& frame, const Body& body, double depth_m, double top_m,
             const FacadeStyle& style) {
  const double rise_m = style.roof_m, back_m = rise_m > 0 ? 0.55 * depth_m : depth_m;
  const double l = body.left_m, r = body.right_m;
  world.AddQuad(frame.At(l, top_m), frame.At(r, top_m), frame.At(r, top_m + rise_m, -back_m),
                frame.At(l, top_m + rise_m, -back_m), style.roof);
  if (rise_m <= 0) return;
  world.AddQuad(frame.At(r, top_m, -depth_m), frame.At(l, top_m, -depth_m),
                frame.At(l, top_m + rise_m, -back_m), frame.At(r, top_m + rise_m, -back_m),
                style.roof);
  const auto gable = [&](double u, double from_w, double to_w) {
    const Vector3d ridge = frame.At(u, top_m + rise_m, -back_m);
    world.AddQuad(frame.At(u, top_m, from_w), frame.At(u, top_m, to_w), ridge, ridge, style.wall, 0,
                  top_m);
  };
  gable(l, -depth_m, 0);
  gable(r, 0, -depth_m);
}

void AddChimney(World& world, const WallFrame& frame, double width_m, double top_m,
                const FacadeStyle& style, Rng& rng) {
  const double u = rng.Uniform(0.5, std::max(0.6, width_m - 1.6));
  AddRelief(world, frame, u, u + rng.Uniform(0.6, 1.1), top_m,
            top_m + style.roof_m + rng.Uniform(0.8, 1.6), -3.4, -2.6, style.wall);
}

void AddSideWalls(World& world, const WallFrame& frame, const Lot& lot, const Body& body,
                  double top_m, std::uint32_t material) {
  const double left = body.left_m, right = body.right_m, d = lot.depth_m, v0 = -kCellar_m;
  const auto wall = [&](const Vector3d& p0, const Vector3d& p1, const Vector3d& p2,
                        const Vector3d& p3, bool is_plane) {
    world.AddQuad(p0, p1, p2, p3, material, 0, v0);
    if (is_plane) world.AddPlane(p0, p1, p2, p3);
  };
  // At a corner the side wall is hidden; it must not cut the front's own openings.
  const double left_w = lot.corner_left ? -kCornerInset_m : 0;
  const double right_w = lot.corner_right ? -kCornerInset_m : 0;
  wall(frame.At(left, v0, -d), frame.At(left, v0, left_w), frame.At(left, top_m, left_w),
       frame.At(left, top_m, -d), !lot.corner_left);
  wall(frame.At(right, v0, right_w), frame.At(right, v0, -d), frame.At(right, top_m, -d),
       frame.At(right, top_m, right_w), !lot.corner_right);
  wall(frame.At(right, v0, -d), frame.At(left, v0, -d), frame.At(left, top_m, -d),
       frame.At(right, top_m, -d), false);
}

}  // namespace

void AddBuilding(World& world, const Lot& lot, Rng style_rng, Rng daily) {
  const Eigen::Vector2d along = lot.b - lot.a;
  const double width_m = along.norm();
  WallFrame frame;
  frame.origin = {lot.a.x(), lot.a.y(), lot.ground_high_m + 0.12};
  frame.u = Vector3d(along.x() / width_m, along.y() / width_m, 0);
  frame.v = Vector3d::UnitZ();
  frame.w = frame.u.cross(frame.v);
  const FacadeStyle style = DrawFacadeStyle(world, width_m, style_rng);
  const double top_m = style.ground_floor_m + (style.floors - 1) * style.floor_m + 0.5;
  const double low_v = lot.ground_low_m - lot.ground_high_m - kCellar_m;

  AddStorey(world, frame, width_m, low_v, 0, {}, style.wall, style.reveal);
  const auto doors = AddGroundFloor(world, frame, width_m, style, style_rng, daily);
  AddStorey(world, frame, width_m, 0, style.ground_floor_m, doors, style.wall, style.reveal);
  AddUpperFloors(world, frame, width_m, style, style_rng);
  AddStorey(world, frame, width_m, top_m - 0.5, top_m, {}, style.wall, style.reveal);
  if (style.cornice) {
    AddRelief(world, frame, -0.02, width_m + 0.02, top_m - 0.3, top_m, 0, 0.35, style.trim);
    AddRelief(world, frame, -0.02, width_m + 0.02, top_m - 0.5, top_m - 0.3, 0, 0.16, style.trim);
  }
  const Body body(lot, width_m);
  AddRoof(world, frame, body, lot.depth_m, top_m, style);
  AddChimney(world, frame, width_m, top_m, style, style_rng);
  AddSideWalls(world, frame, lot, body, top_m, style.wall);
  world.AddPlane(frame.At(0, low_v), frame.At(width_m, low_v), frame.At(width_m, top_m),
                 frame.At(0, top_m));
  ++world.num_buildings;
}

void AddStorey(World& world, const WallFrame& frame, double width_m, double v0, double v1,
               const std::vector<Opening>& openings, std::uint32_t wall, std::uint32_t reveal) {
  const auto piece = [&](double u0, double u1, double low, double high) {
    if (u1 - u0 < 1e-6 || high - low < 1e-6) return;
    world.AddQuad(frame.At(u0, low), frame.At(u1, low), frame.At(u1, high), frame.At(u0, high),
                  wall, u0, low);
  };
  double u = 0;
  for (const Opening& o : openings) {
    piece(u, o.u0, v0, v1);
    piece(o.u0, o.u1, v0, o.v0);
    piece(o.u0, o.u1, o.v1, v1);
    const double r = -o.recess_m;
    world.AddQuad(frame.At(o.u0, o.v0, r), frame.At(o.u1, o.v0, r), frame.At(o.u1, o.v1, r),
                  frame.At(o.u0, o.v1, r), o.pane_material);
    world.AddQuad(frame.At(o.u0, o.v0), frame.At(o.u0, o.v0, r), frame.At(o.u0, o.v1, r),
                  frame.At(o.u0, o.v1), reveal);
    world.AddQuad(frame.At(o.u1, o.v0, r), frame.At(o.u1, o.v0), frame.At(o.u1, o.v1),
                  frame.At(o.u1, o.v1, r), reveal);
    world.AddQuad(frame.At(o.u0, o.v0), frame.At(o.u1, o.v0), frame.At(o.u1, o.v0, r),
                  frame.At(o.u0, o.v0, r), reveal);
    world.AddQuad(frame.At(o.u0, o.v1, r), frame.At(o.u1, o.v1, r), frame.At(o.u1, o.v1),
                  frame.At(o.u0, o.v1), reveal);
    u = o.u1;
  }
  piece(u, width_m, v0, v1);
}

void AddRelief(World& world, const WallFrame& frame, double u0, double u1, double v0, double v1,
               double w0, double w1, std::uint32_t material, bool own_texture) {
  const auto face = [&](const Vector3d& p0, const Vector3d& p1, const Vector3d& p2,
                        const Vector3d& p3) {
    world.AddQuad(p0, p1, p2, p3, material, own_texture ? 0 : u0, own_texture ? 0 : v0);
  };
  face(frame.At(u0, v0, w1), frame.At(u1, v0, w1), frame.At(u1, v1, w1), frame.At(u0, v1, w1));
  face(frame.At(u1, v0, w1), frame.At(u1, v0, w0), frame.At(u1, v1, w0), frame.At(u1, v1, w1));
  face(frame.At(u0, v0, w0), frame.At(u0, v0, w1), frame.At(u0, v1, w1), frame.At(u0, v1, w0));
  face(frame.At(u0, v1, w1), frame.At(u1, v1, w1), frame.At(u1, v1, w0), frame.At(u0, v1, w0));
  face(frame.At(u0, v0, w0), frame.At(u1, v0, w0), frame.At(u1, v0, w1), frame.At(u0, v0, w1));
}

}  // namespace panofix::town
