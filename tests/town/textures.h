#pragma once
// Colour of a point on a material, filtered to the pixel's footprint.

#include "tests/town/world.h"

namespace panofix::town {

struct SurfaceColour {
  Rgb albedo;
  float mirror = 0;  // share of the reflected sky and street, [0, 1]
};

// `u`, `v` in the material's texture frame, metres.
[[nodiscard]] SurfaceColour EvaluateMaterial(const World& world, const Material& material, float u,
                                             float v, const Footprint& footprint);

[[nodiscard]] Rgb WallColour(const WallStyle& style, std::uint32_t seed, float u, float v,
                             const Footprint& f);
[[nodiscard]] SurfaceColour WindowColour(const Material& m, float u, float v, const Footprint& f);
[[nodiscard]] SurfaceColour ShopColour(const Material& m, float u, float v, const Footprint& f);
[[nodiscard]] Rgb DoorColour(const Material& m, float u, float v, const Footprint& f);
[[nodiscard]] Rgb SignColour(const Material& m, float u, float v, const Footprint& f);
[[nodiscard]] Rgb PosterColour(const Material& m, float u, float v, const Footprint& f);
[[nodiscard]] Rgb RoadColour(std::uint32_t seed, float u, float v, const Footprint& f);
[[nodiscard]] Rgb GroundColour(const Material& m, float u, float v, const Footprint& f);
[[nodiscard]] SurfaceColour PropColour(const Material& m, float u, float v, const Footprint& f);

// Coverage of random letters, `height_m` tall, on a line that starts at u = 0, v = 0.
[[nodiscard]] float TextCoverage(float u, float v, float height_m, int num_letters,
                                 std::uint32_t seed, const Footprint& f);
// Sum of octaves doubling from `cells` a metre, amplitude kept: rough surfaces look alike at all
// scales.
[[nodiscard]] float Rough(float u, float v, float cells, int octaves, std::uint32_t seed,
                          const Footprint& f);

}  // namespace panofix::town
