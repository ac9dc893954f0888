#pragma once
// The town's geometry: planar quads with materials and texture frames.

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "tests/town/noise.h"

namespace panofix::town {

enum class MaterialKind : std::uint8_t {
  kPlain,
  kWall,
  kWindow,
  kDoor,
  kShop,
  kSign,
  kPoster,
  kRoof,
  kRoad,
  kManhole,
  kPavement,
  kBark,
  kLeaf,
  kCarBody,
  kCarGlass,
  kWheel,
  kCloth,
  kAwning,
};

enum class WallPattern : std::uint8_t { kBrick, kPlaster, kStone, kPanels };

// How one pattern covers a wall.
struct WallSkin {
  WallPattern pattern = WallPattern::kPlaster;
  Rgb colour{0.5f, 0.5f, 0.5f}, joint{0.4f, 0.4f, 0.4f};
  float unit_width_m = 0.25f, unit_height_m = 0.07f;
  float variation = 0.2f;  // tone difference from unit to unit
  float stain = 0.3f;
};

// A scribble or repair on a wall, in the wall's coordinates.
struct WallMark {
  float u0 = 0, v0 = 0, u1 = 0, v1 = 0;
  Rgb colour;
  std::uint32_t seed = 0;
  bool is_repair = false;
};

struct WallStyle {
  WallSkin upper, base;
  float base_top_m = 0;  // base skin below, upper above
  float floor_height_m = 3;
  float band_height_m = 0;  // string course at each floor; 0 = none
  Rgb band_colour;
  std::vector<WallMark> marks;
};

struct Material {
  MaterialKind kind = MaterialKind::kPlain;
  std::uint32_t seed = 0;
  std::uint32_t ground_seed = 0;  // of the asphalt under paint and around covers
  Rgb a{0.5f, 0.5f, 0.5f}, b{0.3f, 0.3f, 0.3f}, c{0.8f, 0.8f, 0.8f};
  float width_m = 1, height_m = 1;  // extent of the textured object
  int style = 0;                    // kind-specific variant, or the wall style's index
};

// One planar quad, corners counter-clockwise seen from outside; a triangle repeats its third
// corner.
struct Quad {
  Eigen::Vector3f corners[4];
  Eigen::Vector3d normal;  // unit; n . X = d
  double d = 0;
  Eigen::Vector3f origin, u_axis, v_axis;  // texture coordinates of X: (X - origin) . axis + offset
  float u0 = 0, v0 = 0;
  std::uint32_t material = 0;
};

// What the planes of a depth map know: facades, side walls and ground, each a rectangle of one
// plane.
struct PlaneQuad {
  Eigen::Vector3f corners[4];
  Eigen::Vector3d normal;
  double d = 0;
};

struct World {
  std::vector<Quad> quads;
  std::vector<Material> materials;
  std::vector<WallStyle> walls;
  std::vector<PlaneQuad> planes;
  int num_buildings = 0, num_cars = 0, num_trees = 0, num_people = 0, num_rebuilt = 0;

  std::uint32_t AddMaterial(const Material& material);
  // Texture u runs along p0 -> p1, v at right angles; (u0, v0) at p0. Degenerate quads are left
  // out.
  void AddQuad(const Eigen::Vector3d& p0, const Eigen::Vector3d& p1, const Eigen::Vector3d& p2,
               const Eigen::Vector3d& p3, std::uint32_t material, double u0 = 0, double v0 = 0);
  // Parallelepiped from a corner and three edge vectors (right-handed); the face at -z is left out.
  void AddBox(const Eigen::Vector3d& corner, const Eigen::Vector3d& x, const Eigen::Vector3d& y,
              const Eigen::Vector3d& z, std::uint32_t material);
  // Upright tapered prism around `base`, closed at the top.
  void AddPrism(const Eigen::Vector3d& base, double radius_m, double top_radius_m, double height_m,
                int sides, std::uint32_t material);
  void AddPlane(const Eigen::Vector3d& p0, const Eigen::Vector3d& p1, const Eigen::Vector3d& p2,
                const Eigen::Vector3d& p3);
};

}  // namespace panofix::town
