#pragma once
// Colours, hashes and band-limited patterns: the bricks of every procedural texture. Functions of
// the texture coordinates alone (metres), so that any thread may evaluate any pixel.

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace panofix::town {

// Linear light.
struct Rgb {
  float r = 0, g = 0, b = 0;
};
inline Rgb operator*(const Rgb& c, float s) { return {c.r * s, c.g * s, c.b * s}; }
inline Rgb operator*(const Rgb& a, const Rgb& b) { return {a.r * b.r, a.g * b.g, a.b * b.b}; }
inline Rgb operator+(const Rgb& a, const Rgb& b) { return {a.r + b.r, a.g + b.g, a.b + b.b}; }
inline Rgb Mix(const Rgb& a, const Rgb& b, float t) {
  return {a.r + (b.r - a.r) * t, a.g + (b.g - a.g) * t, a.b + (b.b - a.b) * t};
}

// Filter widths of a pixel on the surface along the texture's axes, metres.
struct Footprint {
  float u = 0.01f, v = 0.01f;
  [[nodiscard]] float Max() const { return std::max(u, v); }
};

inline float Clamp01(float x) { return std::min(1.0f, std::max(0.0f, x)); }

inline std::uint32_t Hash(std::uint32_t x, std::uint32_t y, std::uint32_t seed) {
  std::uint32_t h = seed + x * 0x9e3779b1u;
  h ^= h >> 15;
  h = (h + y * 0x85ebca77u) * 0x2c1b3c6du;
  h ^= h >> 12;
  h *= 0x297a2d39u;
  return h ^ (h >> 15);
}
inline std::uint32_t HashInt(int x, int y, std::uint32_t seed) {
  return Hash(static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y), seed);
}
// Uniform in [0, 1) from a hash; `k` picks one of several independent values.
inline float Unit(std::uint32_t hash, std::uint32_t k = 0) {
  const std::uint32_t h = k == 0 ? hash : Hash(hash, k, 0x68bc21ebu);
  return static_cast<float>(h >> 8) * 0x1.0p-24f;
}

inline int FloorInt(float x) {
  const int i = static_cast<int>(x);
  return static_cast<float>(i) > x ? i - 1 : i;
}

// Value noise in [-1, 1], one cell a unit.
inline float ValueNoise(float u, float v, std::uint32_t seed) {
  const int iu = FloorInt(u), iv = FloorInt(v);
  float fu = u - static_cast<float>(iu), fv = v - static_cast<float>(iv);
  fu = fu * fu * (3 - 2 * fu);
  fv = fv * fv * (3 - 2 * fv);
  const float a = Unit(HashInt(iu, iv, seed)), b = Unit(HashInt(iu + 1, iv, seed));
  const float c = Unit(HashInt(iu, iv + 1, seed)), d = Unit(HashInt(iu + 1, iv + 1, seed));
  const float low = a + (b - a) * fu, high = c + (d - c) * fu;
  return 2 * (low + (high - low) * fv) - 1;
}

// 1 where a pattern of `cells` a metre is well resolved, 0 where it is finer than the pixel.
inline float Fade(float footprint_m, float cells) {
  return Clamp01((0.75f - footprint_m * cells) * 2.2f);
}

// One octave of noise, faded out as it nears the pixel's size.
inline float Octave(float u, float v, float cells, std::uint32_t seed, const Footprint& f) {
  const float fade = Fade(f.Max(), cells);
  return fade > 0 ? fade * ValueNoise(u * cells, v * cells, seed) : 0.0f;
}

// Coverage of x > edge by a box filter of width w.
inline float Step(float x, float edge, float w) { return Clamp01((x - edge) / w + 0.5f); }
// Coverage of lo < x < hi.
inline float Band(float x, float lo, float hi, float w) {
  return std::max(0.0f, Step(x, lo, w) - Step(x, hi, w));
}
inline float BoxCoverage(float u, float v, float u0, float u1, float v0, float v1,
                         const Footprint& f) {
  return Band(u, u0, u1, f.u) * Band(v, v0, v1, f.v);
}

// Exact box-filtered pulse train: 1 on the first `duty` metres of every `period`.
inline float Pulses(float x, float period, float duty, float w) {
  const auto integral = [&](float at) {
    const float k = std::floor(at / period);
    return k * duty + std::min(at - k * period, duty);
  };
  return (integral(x + 0.5f * w) - integral(x - 0.5f * w)) / w;
}

}  // namespace panofix::town
