// The ground, and the surfaces of what stands on it.
#include "tests/town/textures.h"

namespace panofix::town {
namespace {

Rgb Pavement(const Material& m, float u, float v, const Footprint& f) {
  const float slab_m = 0.5f;
  const int column = FloorInt(u / slab_m), row = FloorInt(v / slab_m);
  const std::uint32_t h = HashInt(column, row, m.seed);
  const float seen = Fade(f.Max(), 1 / slab_m);
  const float tone = 1 + 0.12f * seen * (2 * Unit(h) - 1);
  const float joint = std::max(Pulses(u, slab_m, 0.012f, f.u), Pulses(v, slab_m, 0.012f, f.v));
  const float spots = ValueNoise(u * 6, v * 6, m.seed ^ 4u);
  const float gum = spots > 0.8f ? 0.25f * Fade(f.Max(), 9) : 0.0f;
  return m.a * (tone * (1 + 0.08f * Rough(u, v, 2, 5, m.seed, f)) * (1 - 0.5f * joint) * (1 - gum));
}

Rgb Manhole(const Material& m, float u, float v, const Footprint& f) {
  const float size = static_cast<float>(m.style) * 1e-3f, x = u - m.width_m, y = v - m.height_m;
  const bool round = m.seed % 3u != 0;
  const float r = round ? std::hypot(x, y) : std::max(std::abs(x), std::abs(y));
  const float in = Clamp01((0.5f * size - r) / f.Max() + 0.5f);
  const float pitch = 0.05f + 0.05f * Unit(m.seed, 1);
  const float bump = Pulses(x + y * (round ? 0.0f : 1.0f), pitch, pitch * 0.5f, f.u) *
                     Pulses(y, pitch, pitch * 0.6f, f.v);
  const float ring = Clamp01((r - 0.42f * size) / f.Max() + 0.5f);
  const float text = TextCoverage(x + 0.2f * size, y + 0.06f * size, 0.13f * size, 3, m.seed, f);
  const Rgb iron = Rgb{0.1f, 0.09f, 0.085f} * (0.6f + 0.9f * bump + 0.8f * text);
  return Mix(RoadColour(m.ground_seed, u, v, f), Mix(iron, {0.2f, 0.19f, 0.18f}, ring), in);
}

SurfaceColour CarBody(const Material& m, float u, float v, const Footprint& f) {
  const std::uint32_t s = m.seed;
  Rgb colour = m.a * (1 + 0.04f * Rough(u, v, 2, 3, s, f));
  float mirror = 0.12f;
  const int face = FloorInt(u / 7);  // sides 0 and 1, ends 2 and 3, lid 4
  const float x = u - 7 * static_cast<float>(face);
  if (face <= 1) {
    for (const float door : {0.34f, 0.58f, 0.78f}) {
      const float at = m.width_m * (door + 0.04f * Unit(s, 1));
      colour = Mix(colour, {0.01f, 0.01f, 0.01f}, 0.8f * Band(x, at, at + 0.012f, f.u));
      const float handle = BoxCoverage(x, v, at + 0.06f, at + 0.2f, 0.72f, 0.75f, f);
      colour = Mix(colour, {0.1f, 0.1f, 0.1f}, handle);
    }
    colour = Mix(colour, {0.02f, 0.02f, 0.02f}, 0.9f * (1 - Step(v, 0.3f, f.v)));
    if (s % 4u == 0) {  // a firm's lettering
      colour = Mix(colour, m.c, TextCoverage(x - 0.38f * m.width_m, v - 0.5f, 0.2f, 8, s, f));
    }
  } else if (face <= 3) {
    const float half = 0.85f, across = std::abs(x - half);
    const Rgb lamp = face == 2 ? Rgb{0.6f, 0.6f, 0.58f} : Rgb{0.4f, 0.02f, 0.02f};
    colour =
        Mix(colour, lamp,
            Band(across, 0.5f, 0.8f, f.u) * Band(v, 0.58f, 0.58f + 0.1f + 0.14f * Unit(s, 2), f.v));
    const float grille = Band(across, -1.0f, 0.42f, f.u) * Band(v, 0.5f, 0.62f, f.v);
    colour = Mix(colour, {0.02f, 0.02f, 0.02f}, 0.8f * grille * (face == 2 ? 1.0f : 0.2f));
    const float plate = Band(across, -1.0f, 0.26f, f.u) * Band(v, 0.32f, 0.43f, f.v);
    const float text = TextCoverage(x - half + 0.24f, v - 0.335f, 0.08f, 7, s, f);
    colour = Mix(colour, Mix({0.75f, 0.75f, 0.7f}, {0.02f, 0.02f, 0.02f}, text), plate);
  }
  const float dirt = Clamp01(0.5f * ValueNoise(u * 1.5f, v * 1.5f, s ^ 1u) + 0.7f - 1.6f * v);
  return {Mix(colour, {0.16f, 0.14f, 0.12f}, 0.4f * dirt), mirror};
}

SurfaceColour CarGlass(const Material& m, float u, float v, const Footprint& f) {
  const int face = FloorInt(u / 7);
  const float x = u - 7 * static_cast<float>(face);
  const float pillar = face <= 1 ? Pulses(x + 0.2f, 1.05f, 0.09f, f.u) : 0.0f;
  const Rgb inside = m.b * (1 + 1.2f * Clamp01(ValueNoise(u * 4, v * 4, m.seed)));
  if (face == 4) return {m.a, 0.15f};  // the roof
  const float sticker = BoxCoverage(x, v, 0.3f, 0.4f, 1.05f, 1.15f, f) * (face >= 2 ? 1.0f : 0.0f);
  return {Mix(Mix(inside, m.c, sticker), m.a, pillar), 0.4f * (1 - pillar)};
}

Rgb Cloth(const Material& m, float u, float v, const Footprint& f) {
  const float stripes = Pulses(m.style % 2 == 0 ? v : u, 0.09f, 0.045f, f.Max());
  const float check = m.style >= 2 ? Pulses(u, 0.07f, 0.03f, f.u) : 0.0f;
  const float fold = 0.2f * Rough(u, v, 7, 3, m.seed, f);
  return Mix(m.a, m.b, 0.6f * std::max(m.style > 0 ? stripes : 0.0f, check)) * (1 + fold);
}

}  // namespace

Rgb RoadColour(std::uint32_t seed, float u, float v, const Footprint& f) {
  const float grain =
      0.14f * Rough(u, v, 9, 4, seed, f) + 0.12f * ValueNoise(u * 0.3f, v * 0.3f, seed ^ 1u);
  Rgb colour = Rgb{0.11f, 0.11f, 0.115f} * (1 + grain);
  const int px = FloorInt(u / 4.7f), py = FloorInt(v / 3.9f);
  const std::uint32_t h = HashInt(px, py, seed ^ 2u);
  if (Unit(h) < 0.4f) {  // a patch of newer asphalt
    const float x = u - 4.7f * static_cast<float>(px), y = v - 3.9f * static_cast<float>(py);
    const float in = BoxCoverage(x, y, 0.3f + Unit(h, 1), 2.0f + 2.2f * Unit(h, 2),
                                 0.2f + Unit(h, 3), 1.8f + 1.8f * Unit(h, 4), f);
    colour = colour * (1 + in * (Unit(h, 5) < 0.6f ? -0.32f : 0.3f));
  }
  const float crack = std::abs(ValueNoise(u * 0.55f, v * 0.55f, seed ^ 3u) +
                               0.3f * ValueNoise(u * 3, v * 3, seed ^ 4u));
  const float soft = 0.014f + 0.8f * f.Max();
  if (crack < 2 * soft)
    colour = colour * (1 - 0.5f * Clamp01(0.014f / soft) * Clamp01(1.5f - crack / soft));
  const float oil = ValueNoise(u * 0.9f, v * 0.9f, seed ^ 5u);
  if (oil > 0.62f) colour = colour * (1 - 0.35f * Clamp01((oil - 0.62f) * 8));
  return colour;
}

Rgb GroundColour(const Material& m, float u, float v, const Footprint& f) {
  if (m.kind == MaterialKind::kManhole) return Manhole(m, u, v, f);
  if (m.kind == MaterialKind::kPavement) return Pavement(m, u, v, f);
  const Rgb asphalt = RoadColour(m.ground_seed, u, v, f);
  if (m.style == 0) return asphalt;
  // Paint, worn through where the noise says so.
  const float wear = 0.5f * ValueNoise(u * 2.2f, v * 2.2f, m.seed) + Rough(u, v, 9, 3, m.seed, f);
  return Mix(m.a, asphalt, Clamp01((wear - 0.25f) * 1.6f));
}

SurfaceColour PropColour(const Material& m, float u, float v, const Footprint& f) {
  switch (m.kind) {
    case MaterialKind::kCarBody:
      return CarBody(m, u, v, f);
    case MaterialKind::kCarGlass:
      return CarGlass(m, u, v, f);
    case MaterialKind::kBark:
      return {Mix(m.a, m.b, Clamp01(0.4f + 0.6f * Rough(u * 3, v * 0.7f, 5, 3, m.seed, f))), 0};
    case MaterialKind::kLeaf: {
      const float tone = Unit(HashInt(FloorInt(u * 0.5f), 1, m.seed));
      return {Mix(m.a, m.b, tone) * (0.75f + 0.35f * Octave(u, v, 12, m.seed, f)), 0};
    }
    case MaterialKind::kWheel: {
      const float r = std::hypot(u, v);
      return {Mix(m.a, m.b, 0.8f * (1 - Step(r, 0.35f * m.height_m, f.Max()))), 0.02f};
    }
    case MaterialKind::kCloth:
      return {Cloth(m, u, v, f), 0};
    case MaterialKind::kAwning: {
      const float stripe = Pulses(u, 0.36f, 0.18f, f.u);
      const float text =
          m.seed % 2u != 0 ? TextCoverage(u - 0.2f, v - 0.04f, 0.13f, 14, m.seed, f) : 0.0f;
      const Rgb cloth = m.style < 2 ? Mix(m.a, m.b, stripe) : m.a;
      return {Mix(cloth, m.c, text) * (1 + 0.1f * Rough(u, v, 2, 3, m.seed, f)), 0};
    }
    default:
      return {m.a * (1 + 0.12f * Rough(u, v, 4, 3, m.seed, f)), 0};
  }
}

SurfaceColour EvaluateMaterial(const World& world, const Material& m, float u, float v,
                               const Footprint& f) {
  switch (m.kind) {
    case MaterialKind::kWall:
      return {WallColour(world.walls[static_cast<std::size_t>(m.style)], m.seed, u, v, f), 0};
    case MaterialKind::kWindow:
      return WindowColour(m, u, v, f);
    case MaterialKind::kShop:
      return ShopColour(m, u, v, f);
    case MaterialKind::kDoor:
      return {DoorColour(m, u, v, f), 0};
    case MaterialKind::kSign:
      return {SignColour(m, u, v, f), 0.03f};
    case MaterialKind::kPoster:
      return {PosterColour(m, u, v, f), 0};
    case MaterialKind::kRoof: {
      const float tile =
          0.8f + 0.2f * Pulses(v, 0.3f, 0.26f, f.v) + 0.15f * Rough(u, v, 4, 3, m.seed, f);
      return {m.a * tile, 0};
    }
    case MaterialKind::kRoad:
    case MaterialKind::kManhole:
    case MaterialKind::kPavement:
      return {GroundColour(m, u, v, f), 0};
    default:
      return PropColour(m, u, v, f);
  }
}

}  // namespace panofix::town
