#pragma once
// Neighbours of a match in either image and their geometric consistency; private to kVLD.

#include <algorithm>
#include <complex>
#include <vector>

namespace panofix {

// A match's points in both images, and the similarity that turns and scales the query image's
// surroundings into the database image's.
struct PlacedMatch {
  std::complex<double> query_px, database_px, database_from_query;
  int query_idx = 0, database_idx = 0;
};

// Where one match's similarity puts the other, against where it is, over the shorter of both; the
// better of the two ways (section 3 of the paper). 0 is perfect.
[[nodiscard]] double GeometricError(const PlacedMatch& a, const PlacedMatch& b);

// Square cells over the points of one image. Holds indices, not the points.
class PointGrid {
 public:
  // Cells at least `range_px` wide.
  PointGrid(const std::vector<std::complex<double>>& points_px, double width_px, double height_px,
            double range_px);
  // Calls `visit(idx)` for all points in the 3 x 3 cells around a point: a superset of those within
  // `range_px`, cell by cell, ascending in each.
  template <typename Visit>
  void ForEachNear(std::complex<double> point_px, Visit visit) const {
    const int column = Cell(point_px.real(), num_columns_), row = Cell(point_px.imag(), num_rows_);
    for (int r = std::max(row - 1, 0); r <= std::min(row + 1, num_rows_ - 1); ++r) {
      const int from = r * num_columns_ + std::max(column - 1, 0);
      const int to = r * num_columns_ + std::min(column + 1, num_columns_ - 1);
      const int end = starts_[static_cast<std::size_t>(to) + 1];
      for (int i = starts_[static_cast<std::size_t>(from)]; i < end; ++i) {
        visit(members_[static_cast<std::size_t>(i)]);
      }
    }
  }

 private:
  [[nodiscard]] int Cell(double at_px, int count) const {
    return static_cast<int>(std::clamp(at_px / cell_px_, 0.0, count - 1.0));
  }
  double cell_px_ = 1;
  int num_columns_ = 1, num_rows_ = 1;
  std::vector<int> starts_, members_;
};

// Finds the neighbours of matches: those at least `min_distance_px` away in both images, and within
// the range in one of them. The range is such that a circle in an image with a share `inlier_rate`
// of its matches right holds 3 right ones on average.
class MatchNeighbours {
 public:
  struct Frame {
    double width_px = 0, height_px = 0;
    double range_px = 0;
  };
  // Keeps a reference to `matches`.
  MatchNeighbours(const std::vector<PlacedMatch>& matches, const Frame& query,
                  const Frame& database, double min_distance_px);

  // Each neighbour once, in an order that depends on the matches alone.
  template <typename Visit>
  void ForEach(int match, Visit visit) const {
    const PlacedMatch& m = matches_[static_cast<std::size_t>(match)];
    query_grid_.ForEachNear(m.query_px, [&](int other) {
      const PlacedMatch& o = matches_[static_cast<std::size_t>(other)];
      const double query_sq = std::norm(m.query_px - o.query_px);
      if (query_sq >= query_range_sq_ || query_sq <= min_distance_sq_) return;
      if (std::norm(m.database_px - o.database_px) > min_distance_sq_) visit(other);
    });
    database_grid_.ForEachNear(m.database_px, [&](int other) {
      const PlacedMatch& o = matches_[static_cast<std::size_t>(other)];
      const double database_sq = std::norm(m.database_px - o.database_px);
      if (database_sq >= database_range_sq_ || database_sq <= min_distance_sq_) return;
      const double query_sq = std::norm(m.query_px - o.query_px);
      if (query_sq >= query_range_sq_) visit(other);  // not yet visited
    });
  }

 private:
  const std::vector<PlacedMatch>& matches_;
  double query_range_sq_, database_range_sq_, min_distance_sq_;
  PointGrid query_grid_, database_grid_;
};

}  // namespace panofix
