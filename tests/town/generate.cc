#include "tests/town/generate.h"

#include <algorithm>

#include "tests/town/building.h"

namespace panofix::town {
namespace {

using Eigen::Vector2d;

constexpr double kOuterDepth_m = 12;  // of the rows that close the town
constexpr double kLookAlikeWidth_m = 9.0;

double GroundAt(const StreetGrid& grid, const Vector2d& p) {
  return grid.GroundHeight(p.x(), p.y());
}

// A row of buildings from a to b, fronts to the right of a -> b. Setbacks go to the left.
struct Row {
  Vector2d a, b;
  std::string name;
  bool closed_ring = false;  // ends meet other rows at right angles
};

// Widths that fill the row exactly.
std::vector<double> Widths(double length_m, bool look_alikes, Rng& rng) {
  std::vector<double> widths;
  double sum = 0;
  while (sum < length_m - 5) {
    widths.push_back(look_alikes ? kLookAlikeWidth_m : rng.Uniform(7, 15));
    sum += widths.back();
  }
  if (look_alikes) {  // equal facades, and one odd house at the end
    widths.back() += length_m - sum;
  } else {
    for (double& width : widths) width *= length_m / sum;
  }
  return widths;
}

void AddRow(World& world, const TownOptions& options, const StreetGrid& grid, const Row& row,
            Day day) {
  Rng lots(options.seed, "lots/" + row.name);
  const Vector2d along = (row.b - row.a).normalized();
  const Vector2d inward(-along.y(), along.x());
  const std::vector<double> widths = Widths((row.b - row.a).norm(), options.look_alikes, lots);
  double at = 0;
  for (std::size_t i = 0; i < widths.size(); ++i) {
    const std::string name = row.name + "/" + std::to_string(i);
    const bool first = i == 0, last = i + 1 == widths.size();
    const bool corner = row.closed_ring && (first || last);
    // Corner houses stand exactly on the line, so that both fronts meet.
    const double setback = corner ? 0 : lots.Uniform(0, 0.7);
    const double skew = corner ? 0 : lots.Uniform(-0.15, 0.15);
    Lot lot;
    lot.a = row.a + along * at + inward * std::max(0.0, setback - skew);
    at += widths[i];
    lot.b = row.a + along * at + inward * std::max(0.0, setback + skew);
    lot.ground_low_m = std::min(GroundAt(grid, lot.a), GroundAt(grid, lot.b));
    lot.ground_high_m = std::max(GroundAt(grid, lot.a), GroundAt(grid, lot.b));
    lot.corner_left = row.closed_ring && first;
    lot.corner_right = row.closed_ring && last;
    const bool rebuilt = Rng(options.seed, "rebuilt/" + name).Uniform() < options.rebuilt_share;
    const bool other = day == Day::kDrive && rebuilt;
    world.num_rebuilt += other;
    const std::string style = options.look_alikes ? "look-alike" : name;
    const std::string daily =
        (day == Day::kDrive && !options.same_light ? "drive/" : "map/") + style;
    AddBuilding(world, lot, Rng(options.seed, (other ? "new-facade/" : "facade/") + style),
                Rng(options.seed, "daily/" + daily));
  }
}

}  // namespace

World GenerateWorld(const TownOptions& options, const StreetGrid& grid, Day day) {
  World world;
  AddStreets(world, options, grid);
  AddBuildings(world, options, grid, day);
  AddProps(world, options, grid, day);
  return world;
}

void AddBuildings(World& world, const TownOptions& options, const StreetGrid& grid, Day day) {
  const auto& xs = grid.x_lines_m;
  const auto& ys = grid.y_lines_m;
  const auto& xh = grid.x_half_widths_m;
  const auto& yh = grid.y_half_widths_m;
  for (std::size_t i = 0; i + 1 < xs.size(); ++i) {
    for (std::size_t j = 0; j + 1 < ys.size(); ++j) {
      const double x0 = xs[i] + xh[i], x1 = xs[i + 1] - xh[i + 1];
      const double y0 = ys[j] + yh[j], y1 = ys[j + 1] - yh[j + 1];
      const std::string name = "block/" + std::to_string(i) + "/" + std::to_string(j);
      AddRow(world, options, grid, {{x0, y0}, {x1, y0}, name + "/south", true}, day);
      AddRow(world, options, grid, {{x1, y0}, {x1, y1}, name + "/east", true}, day);
      AddRow(world, options, grid, {{x1, y1}, {x0, y1}, name + "/north", true}, day);
      AddRow(world, options, grid, {{x0, y1}, {x0, y0}, name + "/west", true}, day);
    }
  }
  const double x0 = xs.front() - xh.front(), x1 = xs.back() + xh.back();
  const double y0 = ys.front() - yh.front(), y1 = ys.back() + yh.back();
  const double d = kOuterDepth_m;
  AddRow(world, options, grid, {{x0 - d, y1}, {x1 + d, y1}, "ring/north", false}, day);
  AddRow(world, options, grid, {{x1, y1 + d}, {x1, y0 - d}, "ring/east", false}, day);
  AddRow(world, options, grid, {{x1 + d, y0}, {x0 - d, y0}, "ring/south", false}, day);
  AddRow(world, options, grid, {{x0, y0 - d}, {x0, y1 + d}, "ring/west", false}, day);
}

}  // namespace panofix::town
