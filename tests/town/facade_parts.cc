// The parts that stand out of a facade or cut into it: trim of windows, doors, shop fronts, signs.
#include <Eigen/Geometry>

#include "tests/town/building.h"

namespace panofix::town {
namespace {

Material Made(MaterialKind kind, Rng& rng, const Rgb& a, const Rgb& b, double width_m,
              double height_m) {
  Material material;
  material.kind = kind;
  material.seed = static_cast<std::uint32_t>(rng());
  material.a = a;
  material.b = b;
  material.c = DrawColour(rng, 0.8, 0.4, 0.95);
  material.width_m = static_cast<float>(width_m);
  material.height_m = static_cast<float>(height_m);
  material.style = static_cast<int>(rng.Below(4));
  return material;
}

void AddBalcony(World& world, const WallFrame& frame, const Opening& o, const FacadeStyle& style,
                Rng& rng) {
  const double out_m = rng.Uniform(0.35, 0.8), u0 = o.u0 - 0.25, u1 = o.u1 + 0.25;
  const double v = o.v0 - 0.12, rail = v + rng.Uniform(0.85, 1.0);
  AddRelief(world, frame, u0, u1, v - 0.14, v, 0, out_m, style.trim);
  AddRelief(world, frame, u0, u1, rail - 0.05, rail, out_m - 0.05, out_m, style.metal);
  const double pitch_m = rng.Uniform(0.11, 0.2);
  for (double u = u0; u < u1; u += pitch_m) {
    world.AddQuad(frame.At(u, v, out_m - 0.03), frame.At(u + 0.025, v, out_m - 0.03),
                  frame.At(u + 0.025, rail, out_m - 0.03), frame.At(u, rail, out_m - 0.03),
                  style.metal);
  }
  if (rng.Uniform() < 0.4) {  // flower boxes
    const auto leaves = world.AddMaterial(
        Made(MaterialKind::kLeaf, rng, {0.1f, 0.22f, 0.06f}, DrawColour(rng, 1, 0.3, 0.9), 1, 1));
    AddRelief(world, frame, u0 + 0.1, u1 - 0.1, v + 0.3, v + rng.Uniform(0.5, 0.75), out_m,
              out_m + 0.2, leaves);
  }
}

// A board with letters flat on the wall and, sometimes, one that hangs over the pavement.
void AddShopSigns(World& world, const WallFrame& frame, double u0, double u1, double v, Rng& rng) {
  const double height_m = rng.Uniform(0.45, 0.75);
  const Rgb board = DrawColour(rng, 0.7, 0.03, 0.5), letters = DrawColour(rng, 0.5, 0.6, 0.95);
  AddRelief(world, frame, u0, u1, v, v + height_m, 0, rng.Uniform(0.06, 0.22),
            world.AddMaterial(Made(MaterialKind::kSign, rng, board, letters, u1 - u0, height_m)),
            true);
  if (rng.Uniform() < 0.5) {
    const double at = rng.Uniform(u0, u1 - 0.1), size_m = rng.Uniform(0.6, 0.9);
    const auto sign = world.AddMaterial(Made(MaterialKind::kSign, rng, DrawColour(rng, 1, 0.1, 0.8),
                                             DrawColour(rng, 0.3, 0.5, 0.95), size_m, size_m));
    const auto p = [&](double u, double dv, double w) { return frame.At(u, v + dv, w); };
    world.AddQuad(p(at, 0, 0.2), p(at, 0, 0.2 + size_m), p(at, size_m, 0.2 + size_m),
                  p(at, size_m, 0.2), sign);
    world.AddQuad(p(at + 0.1, 0, 0.2 + size_m), p(at + 0.1, 0, 0.2), p(at + 0.1, size_m, 0.2),
                  p(at + 0.1, size_m, 0.2 + size_m), sign);
  }
}

void AddAwning(World& world, const WallFrame& frame, double u0, double u1, double v, Rng& rng) {
  const double out_m = rng.Uniform(0.8, 1.4), drop_m = rng.Uniform(0.35, 0.6);
  const auto cloth =
      world.AddMaterial(Made(MaterialKind::kAwning, rng, DrawColour(rng, 0.9, 0.15, 0.7),
                             DrawColour(rng, 0.3, 0.5, 0.9), u1 - u0, out_m));
  const auto p = [&](double u, double dv, double w) { return frame.At(u, v + dv, w); };
  world.AddQuad(p(u0, -drop_m, out_m), p(u1, -drop_m, out_m), p(u1, 0, 0), p(u0, 0, 0), cloth);
  world.AddQuad(p(u0, 0, 0), p(u1, 0, 0), p(u1, -drop_m, out_m), p(u0, -drop_m, out_m), cloth);
  world.AddQuad(p(u0, -drop_m - 0.2, out_m), p(u1, -drop_m - 0.2, out_m), p(u1, -drop_m, out_m),
                p(u0, -drop_m, out_m), cloth);
}

void AddPosters(World& world, const WallFrame& frame, double u0, double u1, Rng& daily) {
  for (double u = u0 + 0.15; u + 0.7 < u1; u += daily.Uniform(0.8, 2.2)) {
    if (daily.Uniform() < 0.55) continue;
    const double w = daily.Uniform(0.4, 0.7), h = w * 1.4, v = daily.Uniform(0.9, 1.5);
    const auto poster =
        world.AddMaterial(Made(MaterialKind::kPoster, daily, DrawColour(daily, 0.8, 0.2, 0.9),
                               DrawColour(daily, 0.9, 0.05, 0.5), w, h));
    world.AddQuad(frame.At(u, v, 0.008), frame.At(u + w, v, 0.008), frame.At(u + w, v + h, 0.008),
                  frame.At(u, v + h, 0.008), poster);
  }
}

Opening MakeDoor(World& world, double u0, double u1, double v1, const FacadeStyle& style,
                 Rng& rng) {
  const Rgb colour = DrawColour(rng, 0.55, 0.06, 0.4);
  const auto door =
      world.AddMaterial(Made(MaterialKind::kDoor, rng, colour, style.frame_colour, u1 - u0, v1));
  return {u0, u1, 0.02, v1, style.recess_m + 0.1, door};
}

}  // namespace

void AddWindowTrim(World& world, const WallFrame& frame, const Opening& o, const FacadeStyle& style,
                   bool balcony, Rng& rng) {
  AddRelief(world, frame, o.u0 - 0.1, o.u1 + 0.1, o.v0 - 0.1, o.v0, 0, 0.12, style.trim);
  if (style.surrounds) {
    AddRelief(world, frame, o.u0 - 0.15, o.u0, o.v0, o.v1, 0, 0.04, style.trim);
    AddRelief(world, frame, o.u1, o.u1 + 0.15, o.v0, o.v1, 0, 0.04, style.trim);
    AddRelief(world, frame, o.u0 - 0.15, o.u1 + 0.15, o.v1, o.v1 + 0.18, 0, 0.07, style.trim);
  }
  const double half_m = 0.5 * (o.u1 - o.u0);
  if (style.shutters && rng.Uniform() < 0.85) {
    AddRelief(world, frame, o.u0 - half_m, o.u0 - 0.02, o.v0, o.v1, 0.04, 0.09, style.shutter);
    AddRelief(world, frame, o.u1 + 0.02, o.u1 + half_m, o.v0, o.v1, 0.04, 0.09, style.shutter);
  }
  if (balcony) {
    AddBalcony(world, frame, o, style, rng);
  } else if (rng.Uniform() < 0.12) {  // air conditioner
    const auto box = world.AddMaterial(
        Made(MaterialKind::kDoor, rng, {0.6f, 0.6f, 0.58f}, {0.2f, 0.2f, 0.2f}, 0.8, 0.5));
    AddRelief(world, frame, o.u0, o.u0 + 0.8, o.v0 - 0.75, o.v0 - 0.2, 0, 0.32, box, true);
  }
}

std::vector<Opening> AddGroundFloor(World& world, const WallFrame& frame, double width_m,
                                    const FacadeStyle& style, Rng& rng, Rng& daily) {
  std::vector<Opening> openings;
  const double lintel_m = style.ground_floor_m - rng.Uniform(0.75, 1.0);
  double u = rng.Uniform(0.4, 0.9);
  const bool door_first = rng.Uniform() < 0.5;
  if (door_first && u + 1.2 < width_m) {
    openings.push_back(MakeDoor(world, u, u + 1.05, std::min(2.4, lintel_m), style, rng));
    u += 1.05 + rng.Uniform(0.35, 0.6);
  }
  while (u + 1.4 < width_m - 0.4) {
    const double room_m = width_m - 0.4 - u;
    if (style.shop) {
      const double w = std::min(room_m, rng.Uniform(2.2, 4.4));
      const auto front =
          world.AddMaterial(Made(MaterialKind::kShop, rng, DrawColour(rng, 0.6, 0.03, 0.4),
                                 DrawColour(daily, 0.7, 0.2, 0.8), w, lintel_m));
      openings.push_back({u, u + w, 0.25, lintel_m, rng.Uniform(0.08, 0.4), front});
      AddShopSigns(world, frame, u - 0.1, u + w + 0.1, lintel_m + 0.05, rng);
      if (rng.Uniform() < 0.35) AddAwning(world, frame, u, u + w, lintel_m, rng);
      u += w;
    } else if (rng.Uniform() < 0.2 && room_m > 2.8) {
      openings.push_back(
          MakeDoor(world, u, u + 2.5, std::min(2.5, lintel_m), style, rng));  // garage
      u += 2.5;
    } else {
      const double w = std::min(style.window_width_m + 0.1, room_m);
      Material pane = Made(MaterialKind::kWindow, rng, style.frame_colour,
                           DrawColour(rng, 0.3, 0.4, 0.9), w, 1.6);
      openings.push_back(
          {u, u + w, 0.9, std::min(2.5, lintel_m), style.recess_m, world.AddMaterial(pane)});
      AddWindowTrim(world, frame, openings.back(), style, false, rng);
      u += w;
    }
    const double pier_m = rng.Uniform(0.35, 1.3);
    AddPosters(world, frame, u + 0.1, std::min(u + pier_m, width_m), daily);
    u += pier_m;
  }
  return openings;
}

}  // namespace panofix::town
