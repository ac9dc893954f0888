// What fills the openings: windows, shop fronts, doors; and what hangs on the walls: signs,
// posters.
#include "tests/town/textures.h"

namespace panofix::town {
namespace {

constexpr int kGlyphColumns = 4, kGlyphRows = 6;

// One of many letters made of random strokes on a 4 x 6 raster.
bool GlyphBit(std::uint32_t letter, int column, int row) {
  if (column < 0 || row < 0 || column >= kGlyphColumns || row >= kGlyphRows) return false;
  const std::uint32_t h = Hash(letter, 0, 0x91u);
  const bool left = column == 0 && (h & 1u), right = column == 3 && (h & 2u);
  const bool top = row == 5 && (h & 4u), low = row == 0 && (h & 8u);
  const bool middle = row == 2 + static_cast<int>((h >> 6) & 1u) && (h & 16u);
  const bool stem = column == 1 + static_cast<int>((h >> 7) & 1u) && (h & 32u);
  const bool diagonal = ((h >> 8) & 3u) == 0 && column * 5 / 3 == row;
  const bool none = (h & 3u) == 0 && !stem;
  return left || right || top || low || middle || stem || diagonal || (none && column == 0);
}

// Things behind glass: a few hashed boxes in rows.
Rgb Goods(const Material& m, float u, float v, std::uint32_t seed, const Footprint& f) {
  const float shelf_m = 0.24f + 0.5f * Unit(seed, 11);
  const int row = FloorInt(v / shelf_m);
  const float cell_m = shelf_m * (0.35f + 0.9f * Unit(HashInt(row, 3, seed)));
  const int column = FloorInt(u / cell_m);
  const std::uint32_t h = HashInt(column, row, seed);
  const float in_u = u - static_cast<float>(column) * cell_m,
              in_v = v - static_cast<float>(row) * shelf_m;
  const float height = shelf_m * (0.3f + 0.65f * Unit(h, 1));
  const float item =
      Unit(h, 2) < 0.75f ? BoxCoverage(in_u, in_v, 0.02f, cell_m * 0.9f, 0.02f, height, f) : 0;
  const float grey = 0.15f + 0.7f * Unit(h, 7);
  const Rgb tint =
      Mix(Mix(m.b, {grey, grey, grey}, 0.6f), {Unit(h, 4), Unit(h, 5), Unit(h, 6)}, 0.4f) * 0.55f;
  const float label =
      BoxCoverage(in_u, in_v, cell_m * 0.25f, cell_m * 0.65f, height * 0.3f, height * 0.6f, f);
  const float depth = 0.035f * (1 + Rough(u, v, 1.3f, 3, seed ^ 21u, f));
  return Mix({depth, depth, 0.9f * depth}, Mix(tint, {0.5f, 0.5f, 0.45f}, label), item);
}

}  // namespace

float TextCoverage(float u, float v, float height_m, int num_letters, std::uint32_t seed,
                   const Footprint& f) {
  const float cell = height_m / kGlyphRows, advance = cell * (kGlyphColumns + 1);
  if (v < -cell || v > height_m + cell || u < -cell) return 0;
  const int index = FloorInt(u / advance);
  if (index < 0 || index >= num_letters) return 0;
  const std::uint32_t letter = HashInt(index, 0, seed) % 997u;
  if (letter % 9 == 0) return 0;  // a space
  // Bilinear between the raster's centres, then cut at one half: rounded strokes.
  const float x = (u - static_cast<float>(index) * advance) / cell - 0.5f, y = v / cell - 0.5f;
  const int ix = FloorInt(x), iy = FloorInt(y);
  const float fx = x - static_cast<float>(ix), fy = y - static_cast<float>(iy);
  const auto bit = [&](int dx, int dy) { return GlyphBit(letter, ix + dx, iy + dy) ? 1.0f : 0.0f; };
  const float low = bit(0, 0) + (bit(1, 0) - bit(0, 0)) * fx,
              high = bit(0, 1) + (bit(1, 1) - bit(0, 1)) * fx;
  const float field = low + (high - low) * fy - 0.4f;
  const float sharp = Clamp01(field / std::max(0.05f, f.Max() / cell) + 0.5f);
  return sharp + (0.4f - sharp) * (1 - Fade(f.Max(), 0.4f / cell));
}

SurfaceColour WindowColour(const Material& m, float u, float v, const Footprint& f) {
  const std::uint32_t s = m.seed;
  const float w = m.width_m, h = m.height_m, frame_m = 0.05f + 0.04f * Unit(s, 1);
  // Behind the glass: dark room, curtains or blinds as each tenant likes.
  Rgb room = Rgb{0.03f, 0.03f, 0.035f} * (1 + 0.8f * ValueNoise(u * 2, v * 2, s ^ 9u));
  float mirror = 0.35f;
  const float drawn = Unit(s, 2);
  if (m.style == 0 || m.style == 1) {
    const float open = (0.15f + 0.5f * drawn) * w * 0.5f + 0.06f * ValueNoise(0, v * 2, s);
    const float curtain = 1 - Band(u, w * 0.5f - open, w * 0.5f + open, f.u);
    const float fold = 0.25f * ValueNoise(u * 16, v * 0.7f, s ^ 2u) * Fade(f.u, 14);
    const float flower = m.style == 1 ? Octave(u, v, 13, s ^ 3u, f) : 0;
    room = Mix(room, m.b * (0.55f + fold + 0.2f * flower), curtain);
  } else if (m.style == 2) {
    const float blind = Step(v, h * (1 - 0.95f * drawn), f.v);
    const float slat = 0.75f + 0.25f * Pulses(v, 0.05f, 0.035f, f.v);
    room = Mix(room, m.b * 0.7f * slat, blind);
  } else if (m.style == 3) {
    room = Mix(room, Goods(m, u, v, s ^ 4u, f) * 1.2f, 1 - Step(v, 0.5f, f.v));
  }
  if (Unit(s, 5) < 0.25f) {  // a plant on the sill
    const float leaf =
        ValueNoise(u * 9, v * 9, s ^ 6u) + 0.9f - 2.4f * v - 3 * std::abs(u - w * drawn);
    room = Mix(room, {0.07f, 0.16f, 0.04f}, Clamp01(leaf / (0.1f + 9 * f.Max())));
  }
  // Frame, mullion and bars.
  const float inside = BoxCoverage(u, v, frame_m, w - frame_m, frame_m, h - frame_m, f);
  float bars = w > 0.7f ? Band(u, w * 0.5f - 0.5f * frame_m, w * 0.5f + 0.5f * frame_m, f.u) : 0;
  const float transom = h * (0.62f + 0.15f * Unit(s, 7));
  if (Unit(s, 8) < 0.7f) bars = std::max(bars, Band(v, transom, transom + 0.04f, f.v));
  const float wood = std::max(1 - inside, bars);
  const Rgb paint = m.a * (0.95f + 0.1f * Octave(u, v, 17, s ^ 10u, f));
  return {Mix(room, paint, wood), mirror * (1 - wood)};
}

SurfaceColour ShopColour(const Material& m, float u, float v, const Footprint& f) {
  const std::uint32_t s = m.seed;
  const float w = m.width_m, h = m.height_m;
  const float pane_m = w / std::max(1.0f, std::round(w / (0.9f + 0.8f * Unit(s, 1))));
  const float plinth = 0.15f + 0.45f * Unit(s, 2);
  Rgb colour = Goods(m, u, v, Hash(s, static_cast<std::uint32_t>(m.b.r * 1e4f), 3), f);
  if (m.style == 1) {  // a scene instead of shelves
    const float scene = Rough(u, v, 1.7f, 4, s ^ 31u, f);
    colour = Mix(Mix({0.04f, 0.04f, 0.045f}, m.b * 0.5f, Clamp01(1.5f * scene)), m.c * 0.4f,
                 Clamp01(4 * scene - 2.4f));
  }
  const float text_m = 0.12f + 0.12f * Unit(s, 3);
  const float text =
      TextCoverage(u - 0.2f * w, v - h * 0.55f, text_m, 4 + static_cast<int>(s % 7u), s ^ 1u, f);
  const float small = TextCoverage(u - 0.1f * w, v - h * 0.4f, 0.06f, 12, s ^ 2u, f);
  colour = Mix(colour, m.c, std::max(text, small));
  const float bars = Pulses(u + 0.03f, pane_m, 0.06f, f.u);
  const float frame = std::max(bars, std::max(1 - Step(v, plinth, f.v), Step(v, h * 0.82f, f.v)));
  const Rgb wood = m.a * (0.85f + 0.2f * Pulses(v + 0.1f * Unit(s, 4), 0.3f, 0.27f, f.v) +
                          0.1f * Octave(u, v, 9, s, f));
  return {Mix(colour, wood, frame), 0.22f * (1 - frame)};
}

Rgb DoorColour(const Material& m, float u, float v, const Footprint& f) {
  const std::uint32_t s = m.seed;
  const float slat_m = m.style == 1 ? 0.06f : 0.35f + 0.3f * Unit(s, 1),
              panel_m = m.style == 1 ? 9.0f : 0.3f + 0.4f * Unit(s, 2);
  const float gap = m.style == 1 ? 0.018f : 0.05f;
  const float relief =
      Pulses(v, slat_m, slat_m - gap, f.v) * Pulses(u, panel_m, panel_m - gap, f.u);
  const float wear = 0.12f * Rough(u, v, 3, 4, s, f);
  Rgb colour = m.a * (0.6f + 0.4f * relief + wear);
  const float knob = BoxCoverage(u, v, m.width_m - 0.18f, m.width_m - 0.1f, 1.0f, 1.12f, f);
  colour = Mix(colour, {0.5f, 0.42f, 0.2f}, m.style == 1 ? 0 : knob);
  const float plate = BoxCoverage(u, v, 0.12f, 0.4f, 1.5f, 1.68f, f);
  if (m.style > 1 && plate > 0) {
    const float text = TextCoverage(u - 0.14f, v - 1.54f, 0.1f, 3, s, f);
    colour = Mix(colour, Mix({0.7f, 0.7f, 0.68f}, {0.03f, 0.03f, 0.15f}, text), plate);
  }
  return colour;
}

Rgb SignColour(const Material& m, float u, float v, const Footprint& f) {
  const std::uint32_t s = m.seed;
  const float w = m.width_m, h = m.height_m;
  // Boards keep wall coordinates; the text repeats with the board's extent.
  const float x = u - std::floor(u / w) * w, y = v - std::floor(v / h) * h;
  const float letter_m = h * (0.4f + 0.25f * Unit(s, 1));
  const int letters = std::max(2, static_cast<int>((0.8f * w) / (letter_m * 0.84f)));
  float ink =
      TextCoverage(x - 0.08f * w, y - 0.3f * (h - letter_m) - 0.1f * h, letter_m, letters, s, f);
  const float small_m = 0.12f * h;
  ink = std::max(ink, TextCoverage(x - 0.1f * w, y - 0.06f * h, small_m,
                                   static_cast<int>(0.7f * w / (small_m * 0.84f)), s ^ 1u, f));
  const float border = 1 - BoxCoverage(x, y, 0.03f, w - 0.03f, 0.03f, h - 0.03f, f);
  Rgb colour = m.a * (1 + 0.1f * Rough(u, v, 4, 3, s ^ 2u, f));
  if (Unit(s, 2) < 0.5f) {  // an emblem
    const float r = std::hypot(x - w * (0.15f + 0.7f * Unit(s, 3)), y - 0.5f * h);
    colour = Mix(colour, m.c, Clamp01((0.32f * h - r) / f.Max() + 0.5f));
  }
  return Mix(Mix(colour, m.c, border * 0.7f), m.b, ink);
}

Rgb PosterColour(const Material& m, float u, float v, const Footprint& f) {
  const float w = m.width_m, h = m.height_m;
  const int column = FloorInt(u / w), row = FloorInt(v / h);
  const std::uint32_t s = HashInt(column, row, m.seed);
  const float x = u - static_cast<float>(column) * w, y = v - static_cast<float>(row) * h;
  const Rgb back = Mix(m.a, {Unit(s, 1), Unit(s, 2), Unit(s, 3)}, 0.6f) * 0.8f;
  const float picture =
      ValueNoise(x * 5 / w, y * 6 / h, s) + 0.5f * Octave(x, y, 14 / w, s ^ 1u, f);
  Rgb colour = Mix(back, m.c, Clamp01(picture / (0.1f + 6 * f.Max()) + 0.3f));
  const float big_m = 0.13f * h;
  const float ink = std::max(
      TextCoverage(x - 0.08f * w, y - 0.8f * h, big_m, static_cast<int>(w / big_m), s ^ 2u, f),
      TextCoverage(x - 0.08f * w, y - 0.07f * h, 0.4f * big_m, static_cast<int>(2.4f * w / big_m),
                   s ^ 3u, f));
  colour = Mix(colour, m.b, ink);
  return Mix({0.6f, 0.6f, 0.57f}, colour, BoxCoverage(x, y, 0.02f, w - 0.02f, 0.02f, h - 0.02f, f));
}

}  // namespace panofix::town
