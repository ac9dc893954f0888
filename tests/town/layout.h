#pragma once
// The plan of the town: a grid of streets on gently sloping ground, and the poses along its
// streets.

#include <Eigen/Core>
#include <string>
#include <vector>

#include "common/geometry/rigid3.h"
#include "tests/town/options.h"

namespace panofix::town {

// Streets run along x = x_lines[i] and y = y_lines[j]. Between facades a street is twice its half
// width wide. Height is a sum of two piecewise linear functions, so each cell of the knots is a
// plane.
struct StreetGrid {
  std::vector<double> x_lines_m, y_lines_m;
  std::vector<double> x_half_widths_m, y_half_widths_m;
  double pavement_m = 2.2, kerb_m = 0.12;
  std::vector<double> x_knots_m, x_heights_m, y_knots_m, y_heights_m;

  [[nodiscard]] double GroundHeight(double x_m, double y_m) const;
  [[nodiscard]] Eigen::Vector3d OnGround(double x_m, double y_m) const {
    return {x_m, y_m, GroundHeight(x_m, y_m)};
  }
  // Unit vector along the ground in a horizontal direction, and the ground's normal.
  [[nodiscard]] Eigen::Vector3d Along(double x_m, double y_m, double dir_x, double dir_y) const;
};

struct PanoramaPose {
  std::string id;
  Rigid3 town_from_pano;
  std::vector<std::string> links;
};

struct FramePose {
  std::int64_t timestamp_ns = 0;
  Rigid3 town_from_cam;
  bool off_map = false;
};

// A path along the streets with rounded corners, by arc length.
class Route {
 public:
  explicit Route(const std::vector<Eigen::Vector2d>& nodes);
  struct Place {
    Eigen::Vector2d position_m, direction;
  };
  [[nodiscard]] double length_m() const { return length_m_; }
  [[nodiscard]] Place At(double arc_m) const;

 private:
  std::vector<Eigen::Vector2d> points_;
  std::vector<double> arcs_m_;
  double length_m_ = 0;
};

struct Layout {
  StreetGrid grid;
  std::vector<PanoramaPose> panoramas;
  std::vector<FramePose> frames;
  double mapped_m = 0;  // length of street with panoramas
};

[[nodiscard]] Layout PlanLayout(const TownOptions& options);

}  // namespace panofix::town
