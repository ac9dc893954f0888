// Draws what a facade is made of: colours, patterns, storeys and marks.
#include "tests/town/building.h"

namespace panofix::town {
namespace {

std::uint32_t Seed(Rng& rng) { return static_cast<std::uint32_t>(rng()); }

WallSkin DrawSkin(Rng& rng, WallPattern pattern) {
  WallSkin skin;
  skin.pattern = pattern;
  skin.stain = static_cast<float>(rng.Uniform(0.15, 0.6));
  skin.variation = static_cast<float>(rng.Uniform(0.15, 0.4));
  const auto units = [&](double width_low, double width_high, double height_low,
                         double height_high) {
    skin.unit_width_m = static_cast<float>(rng.Uniform(width_low, width_high));
    skin.unit_height_m = static_cast<float>(rng.Uniform(height_low, height_high));
  };
  const auto f = [&](double low, double high) {
    return static_cast<float>(rng.Uniform(low, high));
  };
  switch (pattern) {
    case WallPattern::kBrick:
      units(0.21, 0.27, 0.065, 0.085);
      skin.colour = {f(0.22f, 0.5f), f(0.09f, 0.2f), f(0.05f, 0.13f)};
      skin.joint = Rgb{1, 0.95f, 0.88f} * f(0.25f, 0.55f);
      break;
    case WallPattern::kPlaster:
      units(1.0, 2.4, 0.8, 1.9);
      skin.colour = Mix(DrawColour(rng, 0.22, 0.3, 0.75), {0.62f, 0.54f, 0.42f}, f(0.4f, 0.95f));
      skin.joint = skin.colour * 0.7f;
      break;
    case WallPattern::kStone:
      units(0.5, 1.0, 0.26, 0.46);
      skin.colour = Rgb{1, f(0.85f, 0.97f), f(0.66f, 0.88f)} * f(0.3f, 0.62f);
      skin.joint = skin.colour * f(0.45f, 0.8f);
      break;
    case WallPattern::kPanels:
      units(0.8, 1.7, 0.5, 1.2);
      skin.colour = DrawColour(rng, 0.12, 0.25, 0.6);
      skin.joint = skin.colour * 0.35f;
      break;
  }
  return skin;
}

void DrawMarks(WallStyle& wall, double width_m, double height_m, Rng& rng) {
  const auto mark = [&](double u, double v, double w, double h, bool is_repair, const Rgb& colour) {
    wall.marks.push_back({static_cast<float>(u), static_cast<float>(v), static_cast<float>(u + w),
                          static_cast<float>(v + h), colour, Seed(rng), is_repair});
  };
  const int num_repairs = static_cast<int>(rng.Below(5));
  for (int i = 0; i < num_repairs; ++i) {
    const Rgb colour = wall.upper.colour * static_cast<float>(rng.Uniform(0.7, 1.3));
    mark(rng.Uniform(0, width_m), rng.Uniform(0, height_m), rng.Uniform(0.3, 1.8),
         rng.Uniform(0.3, 1.4), true, colour);
  }
  const int num_tags = static_cast<int>(rng.Below(3));
  for (int i = 0; i < num_tags; ++i) {
    mark(rng.Uniform(0, width_m), rng.Uniform(0.3, 1.0), rng.Uniform(0.8, 2.6),
         rng.Uniform(0.5, 1.2), false, DrawColour(rng, 0.9, 0.05, 0.6));
  }
}

}  // namespace

Rgb DrawColour(Rng& rng, double saturation, double low, double high) {
  const double hue = rng.Uniform(0, 6), value = rng.Uniform(low, high);
  const double s = saturation * rng.Uniform(0.2, 1.0);
  const auto channel = [&](double shift) {
    const double k = std::fmod(hue + shift, 6.0);
    const double ramp = std::min(1.0, std::max(0.0, std::abs(k - 3.0) - 1.0));
    return static_cast<float>(value * (1 - s + s * ramp));
  };
  return {channel(0), channel(4), channel(2)};
}

FacadeStyle DrawFacadeStyle(World& world, double width_m, Rng& rng) {
  FacadeStyle style;
  style.floors = 2 + static_cast<int>(rng.Below(4));
  style.floor_m = rng.Uniform(2.8, 3.5);
  style.ground_floor_m = rng.Uniform(3.2, 4.1);
  style.bays = std::max(1, static_cast<int>(width_m / rng.Uniform(2.0, 3.2)));
  const double bay_m = width_m / style.bays;
  style.window_width_m = std::min(rng.Uniform(0.85, 1.7), bay_m - 0.5);
  style.window_height_m = std::min(rng.Uniform(1.3, 2.2), style.floor_m - 0.9);
  style.sill_m = rng.Uniform(0.35, std::max(0.36, style.floor_m - style.window_height_m - 0.35));
  style.recess_m = rng.Uniform(0.1, 0.32);
  style.roof_m = rng.Uniform() < 0.65 ? rng.Uniform(1.2, 3.2) : 0;
  style.shop = rng.Uniform() < 0.55;
  style.shutters = rng.Uniform() < 0.3 && bay_m > 2 * style.window_width_m + 0.2;
  style.balconies = rng.Uniform() < 0.4;
  style.surrounds = rng.Uniform() < 0.6;
  style.cornice = rng.Uniform() < 0.75;
  if (rng.Uniform() < 0.25 && style.bays >= 3) {
    style.bow_bay = 1 + static_cast<int>(rng.Below(static_cast<std::uint64_t>(style.bays - 2)));
  }
  const double light = rng.Uniform();
  style.frame_colour = light < 0.6 ? Rgb{0.75f, 0.74f, 0.7f} : DrawColour(rng, 0.7, 0.08, 0.35);

  WallStyle wall;
  wall.upper = DrawSkin(rng, static_cast<WallPattern>(rng.Below(4)));
  const bool other_base = rng.Uniform() < 0.6;
  wall.base = other_base ? DrawSkin(rng, static_cast<WallPattern>(1 + rng.Below(3))) : wall.upper;
  wall.base_top_m =
      static_cast<float>(rng.Uniform() < 0.5 ? style.ground_floor_m : rng.Uniform(0.4, 1.1));
  wall.floor_height_m = static_cast<float>(style.floor_m);
  wall.band_height_m = rng.Uniform() < 0.5 ? static_cast<float>(rng.Uniform(0.12, 0.3)) : 0.0f;
  wall.band_colour = wall.upper.colour * static_cast<float>(rng.Uniform(0.75, 1.35));
  DrawMarks(wall, width_m, style.ground_floor_m + (style.floors - 1) * style.floor_m, rng);
  world.walls.push_back(wall);

  const auto plain = [&](MaterialKind kind, const Rgb& colour, int style_idx = 0) {
    Material material;
    material.kind = kind;
    material.seed = Seed(rng);
    material.a = colour;
    material.b = colour * 0.6f;
    material.style = style_idx;
    material.width_m = static_cast<float>(width_m);
    return world.AddMaterial(material);
  };
  const Rgb trim =
      Mix(wall.upper.colour, {0.62f, 0.6f, 0.54f}, static_cast<float>(rng.Uniform(0.3, 1)));
  style.wall =
      plain(MaterialKind::kWall, wall.upper.colour, static_cast<int>(world.walls.size() - 1));
  style.trim = plain(MaterialKind::kPlain, trim);
  style.reveal = plain(MaterialKind::kPlain, Mix(wall.upper.colour, trim, 0.5f) * 0.9f);
  style.metal = plain(MaterialKind::kPlain, {0.05f, 0.05f, 0.06f});
  style.shutter = plain(MaterialKind::kDoor, DrawColour(rng, 0.55, 0.1, 0.5), 1);
  style.roof = plain(MaterialKind::kRoof,
                     rng.Uniform() < 0.5 ? Rgb{0.3f, 0.13f, 0.08f} : Rgb{0.13f, 0.14f, 0.17f});
  return style;
}

}  // namespace panofix::town
