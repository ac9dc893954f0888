#pragma once
// Which database views may show what the camera sees: bags of words and landmarks, global or
// windowed.

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "common/map/map_bundle.h"
#include "runtime/retrieval/tile_indices.h"

namespace panofix {

struct RetrievedView {
  std::uint32_t view_idx = 0;
  float similarity = 0;  // [0, 1]
};

struct RetrievalResult {
  std::vector<RetrievedView> views;  // best first, equals by index
  std::int64_t num_compared = 0;     // views that were scored
  std::vector<float> votes;          // of Global alone: the frame's Retrieval::Votes
};

struct RetrievalOptions {
  int num_views = 16;                  // handed on to matching
  int max_views_per_panorama = 4;      // its stations show the same: places are wanted, not views
  bool use_landmarks = true;           // votes of landmarks beside the bags of words
  int num_similar = 8;                 // k of the paper: the best view and k - 1 similar ones
  std::uint64_t max_memory_bytes = 0;  // of the process, kept by dropping tiles; 0 = no bound
};

// What a frame is looked up with.
struct RetrievalQuery {
  const BagOfWords& bag;
  const FeatureSet& sift;
  std::span<const Eigen::Vector2d> bearings;  // of the keypoints, (x/z, y/z)
  const Camera& camera;
  // Asked before each tile of a search in the whole map: true ends it, and nothing is found.
  std::function<bool()> stop;
};

// Used by one thread at a time. Holds the inverted indices of a bundle, tile by tile; no answer
// depends on which tiles are in memory.
class Retrieval {
 public:
  Retrieval(std::shared_ptr<const MapBundle> bundle, const RetrievalOptions& options);
  // The most similar of all views. `best_of_panorama`, where given, receives the similarity of each
  // panorama's best view.
  [[nodiscard]] RetrievalResult Global(const RetrievalQuery& query,
                                       std::vector<float>* best_of_panorama = nullptr) const;
  // The same among the views of all stations of the panoramas of the D_DB x r rows of `around`
  // (paper, section III-B: an ordinary frame searches only there) and of `places`.
  [[nodiscard]] RetrievalResult Windowed(const RetrievalQuery& query,
                                         std::span<const std::uint32_t> around,
                                         std::span<const std::uint32_t> places) const;

  // Among `around` and their rows of D_DB x r alone (all views where it is empty); a view of a
  // panorama stands for those of its virtual stations in its direction. Ranked as above, or the
  // paper's candidates: the most similar view and the first k - 1 of its own row.
  [[nodiscard]] RetrievalResult InRows(const RetrievalQuery& query,
                                       std::span<const std::uint32_t> around, bool ranked) const;

  // LandmarkVotes::Score of all views, without words; empty where landmarks do not vote.
  [[nodiscard]] std::vector<float> Votes(const FeatureSet& sift,
                                         std::span<const Eigen::Vector2d> bearings,
                                         const Camera& camera) const;

  // See TileIndices.
  void Follow(const Eigen::Vector3d& here_in_map, const Eigen::Vector3d& ahead_in_map) const {
    tiles_->Follow(here_in_map, ahead_in_map);
  }
  void Trim() const { tiles_->Trim(); }
  [[nodiscard]] TileMemory memory() const { return tiles_->memory(); }

 private:
  [[nodiscard]] RetrievalResult BestAndItsRow(const std::vector<float>& similarities) const;
  // Nothing where the query was stopped. `landmark_votes`, where given, receives their share.
  [[nodiscard]] std::vector<float> Similarities(const RetrievalQuery& query,
                                                const std::vector<char>& wanted,
                                                std::vector<float>* landmark_votes = nullptr) const;
  // Calls visit(tile, its index) for the tiles with a wanted view (all where `wanted` is empty) and
  // keeps the bound on memory on the way; several tiles at once where there is none. False where
  // `stop` ended it.
  template <typename Visit>
  bool ForEachTile(const std::vector<char>& wanted, const std::function<bool()>& stop,
                   const Visit& visit) const;
  [[nodiscard]] RetrievalResult Best(const std::vector<float>& similarities) const;
  std::shared_ptr<const MapBundle> bundle_;
  RetrievalOptions options_;
  std::unique_ptr<TileIndices> tiles_;
};

}  // namespace panofix
