#pragma once
// One run of kVLD over matches in a fixed order; private to it.

#include <vector>

#include "common/features/kvld.h"
#include "common/features/match_neighbours.h"

namespace panofix {

// Drops matches until each one left has its K supporters, no point two partners, and no match
// neighbours that it contradicts. Memory: 32 neighbours a match at most.
class KvldSelection {
 public:
  // Keeps references to everything given. `matches` are distinct, among `num_query` and
  // `num_database` keypoints; the result depends on their order only where the method ranks two
  // equal.
  KvldSelection(const GradientPyramid& query_image, std::size_t num_query,
                const GradientPyramid& database_image, std::size_t num_database,
                const std::vector<PlacedMatch>& matches, const KvldOptions& options);

  // Whether each match is kept, neighbourhoods sized for `inlier_rate`. Lines compared by an
  // earlier run are not compared again.
  [[nodiscard]] std::vector<char> Run(double inlier_rate);

 private:
  // A neighbour that is geometrically consistent.
  struct Candidate {
    int match = 0;
    float geometric_error = 0;
    float line_distance = kUnknown;
  };
  // Neighbours whose lines match, and the sum of the lines' distances.
  struct Support {
    int count = 0;
    double distance = 0;
  };
  static constexpr float kUnknown = -1;

  void FindCandidates(int match, const MatchNeighbours& neighbours);
  double LineDistanceOf(int match, Candidate* candidate);
  Support SupportOf(int match, int max_count);
  [[nodiscard]] std::vector<char> Contested() const;
  // Each tells whether it dropped any.
  bool DropUnsupported();
  bool DropCompetitors();
  bool DropMisplaced(const MatchNeighbours& neighbours);

  const GradientPyramid &query_image_, &database_image_;
  const std::size_t num_query_, num_database_;
  const std::vector<PlacedMatch>& matches_;
  const KvldOptions& options_;
  // The points of matches, numbered: keypoints of several orientations share one.
  std::vector<int> query_point_, database_point_;
  std::vector<std::vector<Candidate>> candidates_;
  std::vector<char> valid_;
};

}  // namespace panofix
