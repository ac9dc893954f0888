// Walls: bricks, plaster, stone courses and panels, with stains, repairs and graffiti.
#include "tests/town/textures.h"

namespace panofix::town {
namespace {

// Courses of units with joints; alternate rows shifted by a random amount.
Rgb Courses(const WallSkin& skin, std::uint32_t seed, float u, float v, float joint_m,
            const Footprint& f) {
  const float h = skin.unit_height_m;
  const int row = FloorInt(v / h);
  const float row_hash = Unit(HashInt(row, 17, seed));
  const bool running = skin.pattern == WallPattern::kBrick;
  const float width = skin.unit_width_m * (running ? 1.0f : 0.8f + 0.5f * row_hash);
  const float shift = running ? 0.5f * static_cast<float>(row & 1) : row_hash;
  const float x = u / width + shift;
  const int column = FloorInt(x);
  const float in_u = (x - static_cast<float>(column)) * width,
              in_v = v - static_cast<float>(row) * h;
  const std::uint32_t hash = HashInt(column, row, seed);
  const float seen = Fade(f.u, 0.7f / width) * Fade(f.v, 0.7f / h);
  const float tone = 1 + skin.variation * seen * (2 * Unit(hash) - 1);
  const float warm = 0.12f * skin.variation * seen * (2 * Unit(hash, 1) - 1);
  Rgb unit = skin.colour * tone * Rgb{1 + warm, 1, 1 - warm};
  if (!running && Unit(hash, 3) < 0.12f) unit = unit * (1 - 0.3f * seen);  // a replaced stone
  const float full = BoxCoverage(in_u, in_v, joint_m, width, joint_m, h, f);
  const float mean = (1 - joint_m / width) * (1 - joint_m / h);
  return Mix(skin.joint, unit, mean + (full - mean) * Fade(f.Max(), 0.35f / h));
}

// Large repaints with crisp borders, and hair cracks.
Rgb Plaster(const WallSkin& skin, std::uint32_t seed, float u, float v, const Footprint& f) {
  const float patch = 0.08f * ValueNoise(u / skin.unit_width_m, v / skin.unit_height_m, seed ^ 5u);
  Rgb colour = skin.colour * (1 + patch);
  const float crack = std::abs(ValueNoise(u * 0.8f, v * 0.8f, seed ^ 77u) +
                               0.25f * ValueNoise(u * 5, v * 5, seed ^ 78u));
  const float gate = ValueNoise(u * 0.35f, v * 0.35f, seed ^ 79u);
  if (gate > 0.15f && crack < 0.06f) {
    const float width = 0.012f + f.Max();
    colour = colour * (1 - 0.55f * Clamp01(0.012f / width) * Clamp01(2 - crack / 0.018f));
  }
  // Chips of lost plaster.
  const float chip =
      ValueNoise(u * 2.3f, v * 2.3f, seed ^ 80u) + 0.4f * Octave(u, v, 9, seed ^ 81u, f);
  if (chip > 0.82f) {
    const float share = Clamp01((chip - 0.82f) / (0.05f + 3 * f.Max()));
    colour = Mix(colour, skin.joint * 0.8f, share);
  }
  return colour;
}

Rgb Skin(const WallSkin& skin, std::uint32_t seed, float u, float v, const Footprint& f) {
  switch (skin.pattern) {
    case WallPattern::kBrick:
      return Courses(skin, seed, u, v, 0.012f, f) * (1 + 0.1f * Rough(u, v, 12, 3, seed, f));
    case WallPattern::kStone:
      return Courses(skin, seed, u, v, 0.014f, f) * (1 + 0.12f * Rough(u, v, 4, 4, seed, f));
    case WallPattern::kPanels:
      return Courses(skin, seed, u, v, 0.025f, f) * (1 + 0.07f * Rough(u, v, 3, 4, seed, f));
    case WallPattern::kPlaster:
      break;
  }
  return Plaster(skin, seed, u, v, f) * (1 + 0.1f * Rough(u, v, 3, 4, seed, f));
}

// Isolines of smooth noise: strokes of a spray can.
void Scribble(const WallMark& mark, float u, float v, const Footprint& f, Rgb& colour) {
  const float x = (u - mark.u0) * 2.6f, y = (v - mark.v0) * 2.6f;
  const float field =
      ValueNoise(x, y, mark.seed) + 0.4f * ValueNoise(2.3f * x, 2.3f * y, mark.seed ^ 1u);
  const float line = 0.11f, soft = 0.02f + 3.5f * f.Max();
  const float stroke = Clamp01((line - std::abs(field)) / soft + 0.5f) * Clamp01(line / soft);
  colour = Mix(colour, mark.colour, 0.9f * stroke);
}

}  // namespace

float Rough(float u, float v, float cells, int octaves, std::uint32_t seed, const Footprint& f) {
  float sum = 0;
  for (int i = 0; i < octaves; ++i, cells *= 2.1f) {
    if (Fade(f.Max(), cells) <= 0) break;
    sum += Octave(u, v, cells, seed + static_cast<std::uint32_t>(i) * 101u, f);
  }
  return sum;
}

Rgb WallColour(const WallStyle& style, std::uint32_t seed, float u, float v, const Footprint& f) {
  const float base = 1 - Step(v, style.base_top_m, f.v);
  Rgb colour;
  if (base >= 1) {
    colour = Skin(style.base, seed ^ 0xbu, u, v, f);
  } else if (base <= 0) {
    colour = Skin(style.upper, seed, u, v, f);
  } else {
    colour = Mix(Skin(style.upper, seed, u, v, f), Skin(style.base, seed ^ 0xbu, u, v, f), base);
  }
  if (style.band_height_m > 0 && v > style.base_top_m) {
    const float band = Pulses(v - style.base_top_m, style.floor_height_m, style.band_height_m, f.v);
    colour = Mix(colour, style.band_colour * (1 + 0.08f * Octave(u, v, 6, seed ^ 3u, f)), band);
  }
  for (const WallMark& mark : style.marks) {
    if (u < mark.u0 - 0.1f || u > mark.u1 + 0.1f || v < mark.v0 - 0.1f || v > mark.v1 + 0.1f)
      continue;
    if (mark.is_repair) {
      const float wave = 0.05f * ValueNoise(u * 3, v * 3, mark.seed);
      const float in = BoxCoverage(u + wave, v - wave, mark.u0, mark.u1, mark.v0, mark.v1, f);
      colour = Mix(colour, mark.colour * (1 + 0.1f * Rough(u, v, 8, 2, mark.seed, f)), 0.85f * in);
    } else if (u > mark.u0 && u < mark.u1 && v > mark.v0 && v < mark.v1) {
      Scribble(mark, u, v, f, colour);
    }
  }
  // Pits and flecks at hand's breadth: what close views hold on to.
  const float pit =
      ValueNoise(u * 4.5f, v * 4.5f, seed ^ 0x61u) + 0.5f * Octave(u, v, 13, seed ^ 0x62u, f);
  const float seen = Fade(f.Max(), 6) * (0.25f + 0.75f * Unit(seed, 9));
  if (pit > 0.62f) colour = colour * (1 - seen * std::min(0.4f, 1.6f * (pit - 0.62f)));
  if (pit < -0.68f) colour = colour * (1 + seen * std::min(0.3f, 1.4f * (-0.68f - pit)));
  // Runs of dirt, and splashes at the foot.
  const float stain = style.upper.stain;
  const float run = ValueNoise(u * 3.1f, v * 0.25f, seed ^ 0x51u) +
                    0.6f * Octave(u, v * 0.1f, 11, seed ^ 0x52u, f);
  const float blotch = ValueNoise(u * 0.5f, v * 0.5f, seed ^ 0x53u);
  const float foot =
      Clamp01(1 - (v + 0.2f) / (0.5f + 0.3f * ValueNoise(u * 1.7f, 0, seed ^ 0x54u)));
  return colour * (1 - stain * (0.35f * Clamp01(run) + 0.25f * Clamp01(blotch) + 0.5f * foot));
}

}  // namespace panofix::town
