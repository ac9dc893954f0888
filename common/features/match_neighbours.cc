#include "common/features/match_neighbours.h"

#include <algorithm>
#include <cmath>

namespace panofix {
namespace {

template <typename Select>
std::vector<std::complex<double>> Points(const std::vector<PlacedMatch>& matches, Select select) {
  std::vector<std::complex<double>> points;
  points.reserve(matches.size());
  for (const PlacedMatch& m : matches) points.push_back(select(m));
  return points;
}

}  // namespace

double GeometricError(const PlacedMatch& a, const PlacedMatch& b) {
  const std::complex<double> query = b.query_px - a.query_px;
  const std::complex<double> database = b.database_px - a.database_px;
  const auto error_sq = [&](std::complex<double> similarity) {
    const std::complex<double> predicted = {
        similarity.real() * query.real() - similarity.imag() * query.imag(),
        similarity.real() * query.imag() + similarity.imag() * query.real()};
    return std::norm(predicted - database) / std::min(std::norm(predicted), std::norm(database));
  };
  return std::sqrt(std::min(error_sq(a.database_from_query), error_sq(b.database_from_query)));
}

PointGrid::PointGrid(const std::vector<std::complex<double>>& points_px, double width_px,
                     double height_px, double range_px) {
  // No more cells than points: finer ones would only cost memory.
  const double points = std::max<double>(1, static_cast<double>(points_px.size()));
  cell_px_ = std::max(
      {range_px, std::sqrt(width_px * height_px / points), std::max(width_px, height_px) / points});
  num_columns_ = std::max(1, static_cast<int>(std::ceil(width_px / cell_px_)));
  num_rows_ = std::max(1, static_cast<int>(std::ceil(height_px / cell_px_)));
  std::vector<std::size_t> cell_of;
  starts_.assign(static_cast<std::size_t>(num_columns_ * num_rows_) + 1, 0);
  for (const std::complex<double>& p : points_px) {
    const int cell = Cell(p.imag(), num_rows_) * num_columns_ + Cell(p.real(), num_columns_);
    cell_of.push_back(static_cast<std::size_t>(cell));
    ++starts_[cell_of.back() + 1];
  }
  for (std::size_t i = 1; i < starts_.size(); ++i) starts_[i] += starts_[i - 1];
  std::vector<int> next(starts_.begin(), starts_.end() - 1);
  members_.resize(points_px.size());
  for (std::size_t i = 0; i < points_px.size(); ++i) {
    members_[static_cast<std::size_t>(next[cell_of[i]]++)] = static_cast<int>(i);
  }
}

MatchNeighbours::MatchNeighbours(const std::vector<PlacedMatch>& matches, const Frame& query,
                                 const Frame& database, double min_distance_px)
    : matches_(matches),
      query_range_sq_(query.range_px * query.range_px),
      database_range_sq_(database.range_px * database.range_px),
      min_distance_sq_(min_distance_px * min_distance_px),
      query_grid_(Points(matches, [](const PlacedMatch& m) { return m.query_px; }), query.width_px,
                  query.height_px, query.range_px),
      database_grid_(Points(matches, [](const PlacedMatch& m) { return m.database_px; }),
                     database.width_px, database.height_px, database.range_px) {}

}  // namespace panofix
