#pragma once
// One building: a footprint whose front is a wall with openings, relief and ornaments.

#include <string>

#include "common/base/rng.h"
#include "tests/town/world.h"

namespace panofix::town {

// Front from a to b, as seen from the street left to right; outside is right of a -> b seen from
// above.
struct Lot {
  Eigen::Vector2d a, b;
  double ground_low_m = 0, ground_high_m = 0;  // along the front
  double depth_m = 9;
  bool corner_left = false,
       corner_right = false;  // side wall kept away from the corner's other front
};

// `style` decides what the front looks like: the same stream gives the same building. `daily`
// decides what changes from day to day (posters, goods in the shops).
void AddBuilding(World& world, const Lot& lot, Rng style, Rng daily);

// A wall-parallel frame: u right, v up, w out of the wall.
struct WallFrame {
  Eigen::Vector3d origin, u, v, w;
  [[nodiscard]] Eigen::Vector3d At(double u_m, double v_m, double w_m = 0) const {
    return origin + u_m * u + v_m * v + w_m * w;
  }
};

// An opening in the wall, in the wall's coordinates.
struct Opening {
  double u0 = 0, u1 = 0, v0 = 0, v1 = 0;
  double recess_m = 0.2;
  std::uint32_t pane_material = 0;
};

// Style of one building, drawn once.
struct FacadeStyle {
  double floor_m = 3, ground_floor_m = 3.6, roof_m = 0;
  int floors = 3, bays = 4;
  double window_width_m = 1.1, window_height_m = 1.7, sill_m = 0.7, recess_m = 0.2;
  bool shop = false, shutters = false, balconies = false, surrounds = true, cornice = true;
  int bow_bay = -1;  // bay that stands out of the wall on every upper floor; -1: none
  std::uint32_t wall = 0, trim = 0, reveal = 0, metal = 0, shutter = 0, roof = 0;
  Rgb frame_colour;
};

// Wall between and around the openings of one storey, v from v0 to v1.
void AddStorey(World& world, const WallFrame& frame, double width_m, double v0, double v1,
               const std::vector<Opening>& openings, std::uint32_t wall, std::uint32_t reveal);
// Box standing out of the wall. Its texture is the wall's, or its own where `own_texture` is set.
void AddRelief(World& world, const WallFrame& frame, double u0, double u1, double v0, double v1,
               double w0, double w1, std::uint32_t material, bool own_texture = false);
// Sills, surrounds, shutters and balconies of the upper windows.
void AddWindowTrim(World& world, const WallFrame& frame, const Opening& opening,
                   const FacadeStyle& style, bool balcony, Rng& rng);
// Doors, shop front or garage, with signs and awnings; returns the storey's openings.
std::vector<Opening> AddGroundFloor(World& world, const WallFrame& frame, double width_m,
                                    const FacadeStyle& style, Rng& rng, Rng& daily);

[[nodiscard]] FacadeStyle DrawFacadeStyle(World& world, double width_m, Rng& rng);
[[nodiscard]] Rgb DrawColour(Rng& rng, double saturation, double low, double high);

}  // namespace panofix::town
