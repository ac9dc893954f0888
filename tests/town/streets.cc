// The ground: road, markings, manholes, pavements, kerbs and what stands or parks on them.
#include <Eigen/Geometry>
#include <algorithm>

#include "tests/town/building.h"
#include "tests/town/generate.h"
#include "tests/town/props.h"

namespace panofix::town {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kPaint_m = 0.004;  // of paint and covers above the road

std::vector<double> Cuts(const std::vector<double>& knots, double low, double high) {
  std::vector<double> cuts{low};
  for (const double knot : knots) {
    if (knot > low && knot < high) cuts.push_back(knot);
  }
  cuts.push_back(high);
  return cuts;
}

// A patch parallel to the ground, `lift_m` above it, cut where the ground bends. Texture
// coordinates are the plan's.
template <typename Function>
void ForEachPatch(const StreetGrid& grid, double x0, double x1, double y0, double y1, double lift_m,
                  const Function& function) {
  const std::vector<double> xs = Cuts(grid.x_knots_m, x0, x1), ys = Cuts(grid.y_knots_m, y0, y1);
  const auto at = [&](double x, double y) {
    return Vector3d(grid.OnGround(x, y) + Vector3d(0, 0, lift_m));
  };
  for (std::size_t i = 0; i + 1 < xs.size(); ++i) {
    for (std::size_t j = 0; j + 1 < ys.size(); ++j) {
      function(at(xs[i], ys[j]), at(xs[i + 1], ys[j]), at(xs[i + 1], ys[j + 1]),
               at(xs[i], ys[j + 1]));
    }
  }
}

void AddPatch(World& world, const StreetGrid& grid, double x0, double x1, double y0, double y1,
              double lift_m, std::uint32_t material) {
  ForEachPatch(grid, x0, x1, y0, y1, lift_m,
               [&](const Vector3d& a, const Vector3d& b, const Vector3d& c, const Vector3d& d) {
                 world.AddQuad(a, b, c, d, material, a.x(), a.y());
               });
}

// Vertical face of a kerb from p to q; the road lies to the right of p -> q.
void AddKerb(World& world, const StreetGrid& grid, const Vector2d& p, const Vector2d& q,
             std::uint32_t material) {
  const bool along_x = std::abs(q.x() - p.x()) > std::abs(q.y() - p.y());
  const std::size_t axis = along_x ? 0 : 1;
  const auto k = static_cast<Eigen::Index>(axis);
  std::vector<double> cuts =
      Cuts(along_x ? grid.x_knots_m : grid.y_knots_m, std::min(p[k], q[k]), std::max(p[k], q[k]));
  if (q[k] < p[k]) std::reverse(cuts.begin(), cuts.end());
  for (std::size_t i = 0; i + 1 < cuts.size(); ++i) {
    Vector2d a = p, b = p;
    a[k] = cuts[i], b[k] = cuts[i + 1];
    const Vector3d low_a = grid.OnGround(a.x(), a.y()), low_b = grid.OnGround(b.x(), b.y());
    const Vector3d lift(0, 0, grid.kerb_m);
    world.AddQuad(low_a, low_b, low_b + lift, low_a + lift, material, cuts[i], 0);
  }
}

// Pavement ring around a block x0..x1 by y0..y1, or, with `inside`, along the inner edge of the
// town.
void AddPavements(World& world, const StreetGrid& grid, double x0, double x1, double y0, double y1,
                  bool inside, std::uint32_t pavement, std::uint32_t kerb) {
  const double w = inside ? -grid.pavement_m : grid.pavement_m;
  const double under = inside ? -1.0 : 1.0;  // under the fronts that stand back
  const auto patch = [&](double ax, double bx, double ay, double by) {
    AddPatch(world, grid, std::min(ax, bx), std::max(ax, bx), std::min(ay, by), std::max(ay, by),
             grid.kerb_m, pavement);
  };
  patch(x0 - w, x1 + w, y0 - w, y0 + under);
  patch(x0 - w, x1 + w, y1 - under, y1 + w);
  patch(x0 - w, x0 + under, y0 + under, y1 - under);
  patch(x1 - under, x1 + w, y0 + under, y1 - under);
  const Vector2d corners[4] = {
      {x0 - w, y0 - w}, {x1 + w, y0 - w}, {x1 + w, y1 + w}, {x0 - w, y1 + w}};
  for (std::size_t i = 0; i < 4; ++i) {
    const Vector2d &p = corners[i], &q = corners[(i + 1) % 4];
    inside ? AddKerb(world, grid, q, p, kerb) : AddKerb(world, grid, p, q, kerb);
  }
}

// A stretch of street between two crossings, in its own coordinates: `along` from 0, `across` from
// the centre line, positive to the left.
struct Stretch {
  bool is_x = true;  // runs along x
  double line_m = 0, from_m = 0, to_m = 0, half_width_m = 6;
  std::string name;
  [[nodiscard]] double length_m() const { return to_m - from_m; }
  [[nodiscard]] Vector2d At(double along, double across) const {
    return is_x ? Vector2d(from_m + along, line_m + across)
                : Vector2d(line_m - across, from_m + along);
  }
};

std::vector<Stretch> Stretches(const StreetGrid& grid) {
  std::vector<Stretch> stretches;
  const auto add = [&](bool is_x, const std::vector<double>& lines,
                       const std::vector<double>& halves, const std::vector<double>& cross,
                       const std::vector<double>& cross_halves) {
    for (std::size_t i = 0; i < lines.size(); ++i) {
      for (std::size_t k = 0; k + 1 < cross.size(); ++k) {
        stretches.push_back(
            {is_x, lines[i], cross[k] + cross_halves[k], cross[k + 1] - cross_halves[k + 1],
             halves[i],
             std::string(is_x ? "x/" : "y/") + std::to_string(i) + "/" + std::to_string(k)});
      }
    }
  };
  add(true, grid.y_lines_m, grid.y_half_widths_m, grid.x_lines_m, grid.x_half_widths_m);
  add(false, grid.x_lines_m, grid.x_half_widths_m, grid.y_lines_m, grid.y_half_widths_m);
  return stretches;
}

void AddRectangle(World& world, const StreetGrid& grid, const Stretch& s, double along0,
                  double along1, double across0, double across1, std::uint32_t material) {
  const Vector2d p = s.At(along0, across0), q = s.At(along1, across1);
  AddPatch(world, grid, std::min(p.x(), q.x()), std::max(p.x(), q.x()), std::min(p.y(), q.y()),
           std::max(p.y(), q.y()), kPaint_m, material);
}

void AddMarkings(World& world, const TownOptions& options, const StreetGrid& grid, const Stretch& s,
                 std::uint32_t paint, std::uint32_t ground_seed) {
  Rng rng(options.seed, "marking/" + s.name);
  const double road = s.half_width_m - grid.pavement_m;
  const double dash = rng.Uniform(1.2, 2.5), gap = rng.Uniform(1.2, 2.5);
  for (double a = 4; a + dash < s.length_m() - 4; a += dash + gap) {
    AddRectangle(world, grid, s, a, a + dash, -0.06, 0.06, paint);
  }
  for (const double start : {-2.0, s.length_m() - 1.0}) {  // zebra crossings
    if (rng.Uniform() < 0.25) continue;
    for (double c = -road + 0.3; c + 0.5 < road; c += 1.0) {
      AddRectangle(world, grid, s, start, start + 3, c, c + 0.5, paint);
    }
  }
  const int covers = 1 + static_cast<int>(s.length_m() / 14);
  for (int i = 0; i < covers; ++i) {
    Material cover;
    cover.kind = MaterialKind::kManhole;
    cover.ground_seed = ground_seed;
    cover.seed = static_cast<std::uint32_t>(rng());
    const double along = rng.Uniform(1, s.length_m() - 2),
                 across = rng.Uniform(-road + 0.3, road - 1.0);
    const double size = rng.Uniform(0.5, 0.8);
    const Vector2d p = s.At(along, across);
    cover.width_m = static_cast<float>(p.x() + (s.is_x ? 0.5 : -0.5) * size);
    cover.height_m = static_cast<float>(p.y() + 0.5 * size);
    cover.style = static_cast<int>(1000 * size);
    AddRectangle(world, grid, s, along, along + size, across, across + size,
                 world.AddMaterial(cover));
  }
}

Stand StandAt(const StreetGrid& grid, const Stretch& s, double along, double across, double lift_m,
              bool backwards) {
  const Vector2d p = s.At(along, across),
                 ahead = (s.At(along + 1, across) - p) * (backwards ? -1 : 1);
  Stand stand;
  stand.base = grid.OnGround(p.x(), p.y()) + Vector3d(0, 0, lift_m);
  stand.forward = grid.Along(p.x(), p.y(), ahead.x(), ahead.y());
  return stand;
}

// Trees and furniture stand near the kerb on either side and stay from day to day.
void AddFurniture(World& world, const TownOptions& options, const StreetGrid& grid,
                  const Stretch& s, bool left, const std::string& day_name) {
  const std::string name = s.name + (left ? "/left" : "/right");
  Rng rng(options.seed, "furniture/" + name);
  const double side = left ? 1 : -1;
  const double across = side * (s.half_width_m - grid.pavement_m + 0.45);
  const bool trees = rng.Uniform() < 0.6;
  int k = 0;
  for (double along = rng.Uniform(2, 6); along < s.length_m() - 2;
       along += rng.Uniform(4, 9), ++k) {
    const std::string item = name + "/" + std::to_string(k);
    const Stand stand = StandAt(grid, s, along, across, grid.kerb_m, !left);
    const Rng shape(options.seed, "prop/" + item), daily(options.seed, "prop/" + day_name + item);
    const double pick = rng.Uniform();
    if (trees && pick < 0.4) {
      const bool other_leaves = Rng(options.seed, "leaves/" + item).Uniform() < 0.3;
      const Rng leaves(options.seed, (other_leaves ? "leaf/" + day_name : "leaf/") + item);
      AddTree(world, stand, shape, leaves);
    } else if (pick < 0.52) {
      AddLampPost(world, stand, shape);
    } else if (pick < 0.64) {
      AddStreetSign(world, stand, shape);
    } else if (pick < 0.78) {
      for (int b = 0; b < 4; ++b)
        AddBollard(world, StandAt(grid, s, along + 0.9 * b, across, grid.kerb_m, false), shape);
    } else if (pick < 0.88) {
      AddBin(world, stand, daily);
    } else if (pick < 0.92) {
      AddPosterColumn(world, StandAt(grid, s, along, across + 0.45 * side, grid.kerb_m, false),
                      shape, daily);
    }
  }
}

void AddTraffic(World& world, const TownOptions& options, const StreetGrid& grid, const Stretch& s,
                bool left, const std::string& day_name) {
  const std::string name = day_name + s.name + (left ? "/left" : "/right");
  Rng rng(options.seed, "traffic/" + name);
  const double side = left ? 1 : -1, kerb = s.half_width_m - grid.pavement_m;
  const double density = rng.Uniform(0.35, 0.8);
  int k = 0;
  for (double along = rng.Uniform(4, 8); along < s.length_m() - 5;
       along += rng.Uniform(5.4, 7), ++k) {
    if (rng.Uniform() > density) continue;
    const Stand stand = StandAt(grid, s, along, side * (kerb - 1.1 - rng.Uniform(0, 0.2)), 0, left);
    const std::string look = options.look_alikes ? "look-alike" : name + "/" + std::to_string(k);
    AddCar(world, stand, Rng(options.seed, "car/" + look));
  }
  const int people = static_cast<int>(rng.Below(4) * static_cast<std::uint64_t>(s.length_m()) / 40);
  for (int i = 0; i < people; ++i) {
    const double across = side * (s.half_width_m - rng.Uniform(0.6, 1.5));
    const Stand stand = StandAt(grid, s, rng.Uniform(1, s.length_m() - 1), across, grid.kerb_m,
                                rng.Uniform() < 0.5);
    AddPerson(world, stand, Rng(options.seed, "person/" + name + "/" + std::to_string(i)));
  }
}

}  // namespace

void AddStreets(World& world, const TownOptions& options, const StreetGrid& grid) {
  const auto ground = [&](MaterialKind kind, const char* stream, const Rgb& colour) {
    Rng rng(options.seed, stream);
    Material material;
    material.kind = kind;
    material.seed = static_cast<std::uint32_t>(rng());
    material.ground_seed = material.seed;
    material.a = colour;
    return world.AddMaterial(material);
  };
  const auto road = ground(MaterialKind::kRoad, "road", {0.11f, 0.11f, 0.115f});
  const auto pavement = ground(MaterialKind::kPavement, "pavement", {0.27f, 0.26f, 0.245f});
  const auto kerb = ground(MaterialKind::kPlain, "kerb", {0.36f, 0.35f, 0.33f});
  Rng rng(options.seed, "paint");
  Material paint;
  paint.kind = MaterialKind::kRoad;
  paint.style = 1;
  paint.ground_seed = world.materials[road].ground_seed;
  paint.seed = static_cast<std::uint32_t>(rng());
  paint.a = {0.55f, 0.55f, 0.53f};
  const auto paint_idx = world.AddMaterial(paint);

  const double x0 = grid.x_knots_m.front(), x1 = grid.x_knots_m.back();
  const double y0 = grid.y_knots_m.front(), y1 = grid.y_knots_m.back();
  AddPatch(world, grid, x0, x1, y0, y1, 0, road);
  ForEachPatch(grid, x0, x1, y0, y1, 0,
               [&](const Vector3d& a, const Vector3d& b, const Vector3d& c, const Vector3d& d) {
                 world.AddPlane(a, b, c, d);
               });
  const auto& xs = grid.x_lines_m;
  const auto& ys = grid.y_lines_m;
  for (std::size_t i = 0; i + 1 < xs.size(); ++i) {
    for (std::size_t j = 0; j + 1 < ys.size(); ++j) {
      AddPavements(world, grid, xs[i] + grid.x_half_widths_m[i],
                   xs[i + 1] - grid.x_half_widths_m[i + 1], ys[j] + grid.y_half_widths_m[j],
                   ys[j + 1] - grid.y_half_widths_m[j + 1], false, pavement, kerb);
    }
  }
  AddPavements(world, grid, xs.front() - grid.x_half_widths_m.front(),
               xs.back() + grid.x_half_widths_m.back(), ys.front() - grid.y_half_widths_m.front(),
               ys.back() + grid.y_half_widths_m.back(), true, pavement, kerb);
  for (const Stretch& s : Stretches(grid))
    AddMarkings(world, options, grid, s, paint_idx, paint.ground_seed);
}

void AddProps(World& world, const TownOptions& options, const StreetGrid& grid, Day day) {
  const std::string day_name = day == Day::kDrive && !options.same_light ? "drive/" : "map/";
  for (const Stretch& s : Stretches(grid)) {
    for (const bool left : {false, true}) {
      AddFurniture(world, options, grid, s, left, day_name);
      AddTraffic(world, options, grid, s, left, day_name);
    }
  }
}

}  // namespace panofix::town
