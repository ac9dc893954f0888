#include "common/features/kvld_selection.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <tuple>
#include <unordered_map>
#include <unordered_set>

#include "common/features/gradient_pyramid.h"
#include "common/features/virtual_line.h"

namespace panofix {
namespace {

// Candidates kept a match, the geometrically most consistent ones: bounds memory and the lines
// looked at where matches crowd, far above K.
constexpr std::size_t kMaxCandidates = 32;
constexpr int kMaxSupporters = 20;           // counted to rank a match among its competitors
constexpr double kMinConsistentShare = 0.3;  // of the neighbours of a match that is in place, or
constexpr double kMaxMeanError = 1.2;        // their mean geometric error

constexpr int kNone = -1, kSeveral = -2;  // points

// Numbers of distinct points, in the order of their coordinates.
template <typename PointOf>
std::vector<int> NumberedPoints(const std::vector<PlacedMatch>& matches, PointOf point_of) {
  std::vector<int> order(matches.size()), numbers(matches.size());
  std::iota(order.begin(), order.end(), 0);
  const auto coordinates = [&](int i) {
    const std::complex<double> p = point_of(matches[static_cast<std::size_t>(i)]);
    return std::pair(p.real(), p.imag());
  };
  std::sort(order.begin(), order.end(),
            [&](int a, int b) { return coordinates(a) < coordinates(b); });
  int number = 0;
  for (std::size_t i = 0; i < order.size(); ++i) {
    if (i > 0 && coordinates(order[i]) != coordinates(order[i - 1])) ++number;
    numbers[static_cast<std::size_t>(order[i])] = number;
  }
  return numbers;
}

// The radius of a circle that holds, on average, three of `num` matches' right ones.
MatchNeighbours::Frame FrameOf(const GradientPyramid& image, std::size_t num, double inlier_rate) {
  const double width_px = image.impl().width_px, height_px = image.impl().height_px;
  const double right_ones = inlier_rate * static_cast<double>(num);
  return {width_px, height_px,
          std::sqrt(3 * width_px * height_px / (std::numbers::pi * right_ones))};
}

}  // namespace

KvldSelection::KvldSelection(const GradientPyramid& query_image, std::size_t num_query,
                             const GradientPyramid& database_image, std::size_t num_database,
                             const std::vector<PlacedMatch>& matches, const KvldOptions& options)
    : query_image_(query_image),
      database_image_(database_image),
      num_query_(std::min(num_query, matches.size())),
      num_database_(std::min(num_database, matches.size())),
      matches_(matches),
      options_(options),
      query_point_(NumberedPoints(matches, [](const PlacedMatch& m) { return m.query_px; })),
      database_point_(NumberedPoints(matches, [](const PlacedMatch& m) { return m.database_px; })),
      candidates_(matches.size()) {}

std::vector<char> KvldSelection::Run(double inlier_rate) {
  const MatchNeighbours neighbours(matches_, FrameOf(query_image_, num_query_, inlier_rate),
                                   FrameOf(database_image_, num_database_, inlier_rate),
                                   options_.min_distance_px);
  const int count = static_cast<int>(matches_.size());
  for (int i = 0; i < count; ++i) FindCandidates(i, neighbours);
  valid_.assign(matches_.size(), 1);
  for (bool dropped = true; dropped;) {
    dropped = DropUnsupported();
    dropped |= DropCompetitors();
    dropped |= DropMisplaced(neighbours);
  }
  return valid_;
}

void KvldSelection::FindCandidates(int match, const MatchNeighbours& neighbours) {
  const auto at = static_cast<std::size_t>(match);
  std::vector<Candidate> found;
  neighbours.ForEach(match, [&](int other) {
    const PlacedMatch &a = matches_[at], &b = matches_[static_cast<std::size_t>(other)];
    const double error = GeometricError(a, b);
    if (error < options_.distance_threshold) found.push_back({other, static_cast<float>(error)});
  });
  std::sort(found.begin(), found.end(), [](const Candidate& a, const Candidate& b) {
    return std::tie(a.geometric_error, a.match) < std::tie(b.geometric_error, b.match);
  });
  if (found.size() > kMaxCandidates) found.resize(kMaxCandidates);
  for (const Candidate& known : candidates_[at]) {
    const auto same = std::find_if(found.begin(), found.end(), [&](const Candidate& candidate) {
      return candidate.match == known.match;
    });
    if (same != found.end()) same->line_distance = known.line_distance;
  }
  candidates_[at].assign(found.begin(), found.end());
}

double KvldSelection::LineDistanceOf(int match, Candidate* candidate) {
  if (candidate->line_distance != kUnknown) return candidate->line_distance;
  // Always from the first match to the second: the way back differs by rounding.
  const auto [first, second] = std::minmax(match, candidate->match);
  const PlacedMatch& a = matches_[static_cast<std::size_t>(first)];
  const PlacedMatch& b = matches_[static_cast<std::size_t>(second)];
  const LineDescriptor query_line = DescribeLine(query_image_, a.query_px.real(), a.query_px.imag(),
                                                 b.query_px.real(), b.query_px.imag(), options_);
  const LineDescriptor database_line =
      DescribeLine(database_image_, a.database_px.real(), a.database_px.imag(),
                   b.database_px.real(), b.database_px.imag(), options_);
  candidate->line_distance = static_cast<float>(LineDistance(query_line, database_line, options_));
  for (Candidate& back : candidates_[static_cast<std::size_t>(candidate->match)]) {
    if (back.match == match) back.line_distance = candidate->line_distance;
  }
  return candidate->line_distance;
}

KvldSelection::Support KvldSelection::SupportOf(int match, int max_count) {
  Support support;
  for (Candidate& candidate : candidates_[static_cast<std::size_t>(match)]) {
    if (support.count == max_count) break;
    if (valid_[static_cast<std::size_t>(candidate.match)] == 0) continue;
    const double distance = LineDistanceOf(match, &candidate);
    if (!(distance < options_.descriptor_threshold)) continue;
    ++support.count;
    support.distance += distance;
  }
  return support;
}

bool KvldSelection::DropUnsupported() {
  std::vector<int> dropped;
  for (int i = 0; i < static_cast<int>(matches_.size()); ++i) {
    if (valid_[static_cast<std::size_t>(i)] == 0) continue;
    if (SupportOf(i, options_.min_connected).count < options_.min_connected) dropped.push_back(i);
  }
  for (const int i : dropped) valid_[static_cast<std::size_t>(i)] = 0;
  return !dropped.empty();
}

// Whether each match is valid and shares its keypoint or its point in just one image with another
// that is. Matches of keypoints that differ in orientation alone agree, and are no such.
std::vector<char> KvldSelection::Contested() const {
  std::vector<int> database_of(matches_.size(), kNone), query_of(matches_.size(), kNone);
  std::unordered_map<int, int> uses_of_query, uses_of_database;
  const auto join = [](int point, int* other_point) {
    *other_point = *other_point == kNone || *other_point == point ? point : kSeveral;
  };
  for (std::size_t i = 0; i < matches_.size(); ++i) {
    if (valid_[i] == 0) continue;
    join(database_point_[i], &database_of[static_cast<std::size_t>(query_point_[i])]);
    join(query_point_[i], &query_of[static_cast<std::size_t>(database_point_[i])]);
    ++uses_of_query[matches_[i].query_idx], ++uses_of_database[matches_[i].database_idx];
  }
  std::vector<char> contested(matches_.size(), 0);
  for (std::size_t i = 0; i < matches_.size(); ++i) {
    if (valid_[i] == 0) continue;
    contested[i] = database_of[static_cast<std::size_t>(query_point_[i])] == kSeveral ||
                   query_of[static_cast<std::size_t>(database_point_[i])] == kSeveral ||
                   uses_of_query[matches_[i].query_idx] > 1 ||
                   uses_of_database[matches_[i].database_idx] > 1;
  }
  return contested;
}

// Of contested matches the best supported are kept.
bool KvldSelection::DropCompetitors() {
  const std::vector<char> is_contested = Contested();
  struct Ranked {
    int match = 0;
    Support support;
  };
  std::vector<Ranked> competitors;
  for (int i = 0; i < static_cast<int>(matches_.size()); ++i) {
    if (is_contested[static_cast<std::size_t>(i)] != 0) {
      competitors.push_back({i, SupportOf(i, kMaxSupporters)});
    }
  }
  std::sort(competitors.begin(), competitors.end(), [](const Ranked& a, const Ranked& b) {
    return std::tuple(-a.support.count, a.support.distance, a.match) <
           std::tuple(-b.support.count, b.support.distance, b.match);
  });
  std::vector<int> database_of(matches_.size(), kNone), query_of(matches_.size(), kNone);
  std::unordered_set<int> used_query, used_database;
  bool dropped = false;
  for (const Ranked& ranked : competitors) {
    const auto at = static_cast<std::size_t>(ranked.match);
    int& database = database_of[static_cast<std::size_t>(query_point_[at])];
    int& query = query_of[static_cast<std::size_t>(database_point_[at])];
    const bool is_free = (database == kNone || database == database_point_[at]) &&
                         (query == kNone || query == query_point_[at]) &&
                         !used_query.contains(matches_[at].query_idx) &&
                         !used_database.contains(matches_[at].database_idx);
    if (is_free) {
      database = database_point_[at], query = query_point_[at];
      used_query.insert(matches_[at].query_idx), used_database.insert(matches_[at].database_idx);
    } else {
      valid_[at] = 0, dropped = true;
    }
  }
  return dropped;
}

bool KvldSelection::DropMisplaced(const MatchNeighbours& neighbours) {
  std::vector<int> dropped;
  for (int i = 0; i < static_cast<int>(matches_.size()); ++i) {
    const PlacedMatch& match = matches_[static_cast<std::size_t>(i)];
    if (valid_[static_cast<std::size_t>(i)] == 0) continue;
    int num_neighbours = 0, num_consistent = 0;
    double error_sum = 0;
    neighbours.ForEach(i, [&](int other) {
      if (valid_[static_cast<std::size_t>(other)] == 0) return;
      const double error = GeometricError(match, matches_[static_cast<std::size_t>(other)]);
      ++num_neighbours, error_sum += error;
      if (error < options_.distance_threshold) ++num_consistent;
    });
    if (num_consistent < kMinConsistentShare * num_neighbours &&
        error_sum > kMaxMeanError * num_neighbours) {
      dropped.push_back(i);
    }
  }
  for (const int i : dropped) valid_[static_cast<std::size_t>(i)] = 0;
  return !dropped.empty();
}

}  // namespace panofix
