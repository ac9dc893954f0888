#pragma once
// Retrieval by landmarks: keypoints vote for the views that show a landmark like them, at the place
// in the picture and the size that the view's own pose would give it.

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "common/camera/camera.h"
#include "common/features/features.h"
#include "common/map/local_frame.h"
#include "common/map/map_bundle.h"

namespace panofix {

struct VoteOptions {
  int num_words = 3;              // looked up a keypoint: a descriptor lies near several
  double descriptor_sigma = 140;  // of RootSIFT bytes: a vote weighs exp(-d^2 / 2 sigma^2)
  double max_descriptor_distance = 300;
  double max_turn_deg = 25;     // of the keypoint against the landmark
  double max_size_ratio = 2.0;  // of the keypoint against the landmark seen from the station
  double max_across_deg = 28;   // a view's direction is half a step off at most, and parallax
  double max_up_deg = 10;       // the camera's tilt, and parallax
  double bin_deg = 9;           // turns that agree; two neighbours are one
};

// The keypoints of a frame, ready to vote in any tile.
struct Voters {
  // `bearings` (x/z, y/z) go with the keypoints; all arguments but `options` outlive it.
  Voters(const Vocabulary& vocabulary, const FeatureSet& sift_features,
         std::span<const Eigen::Vector2d> keypoint_bearings, const Camera& frame_camera,
         const VoteOptions& options);
  const FeatureSet& sift;
  std::span<const Eigen::Vector2d> bearings;
  const Camera& camera;                           // took the frame
  std::vector<std::vector<std::uint32_t>> words;  // nearest ones of each keypoint
  // Codes of the orientations (schemas/bundle.md) that each may have in the map: `count` from
  // `first` on, 0 after 255.
  struct Codes {
    std::uint8_t first = 0;
    int count = 0;
  };
  std::vector<Codes> angles;
};

// The landmarks of one tile. Words (Sivic and Zisserman, ICCV 2003) find them, descriptors and weak
// geometry (Jegou, Douze and Schmid, ECCV 2008) weigh them. Immutable, thread-safe.
class TileVotes {
 public:
  // `words` of the tile's landmarks, stored or derived (MapTile); `local` is any frame near the
  // map. The bundle outlives it, and its tile is asked for with every score.
  TileVotes(const MapBundle& bundle, std::size_t tile, std::span<const std::uint32_t> words,
            const LocalFrame& local, const VoteOptions& options);
  // Votes for each view of the tile, 0 and up, into `scores` (of all views); only for views with
  // `wanted` set where it is not empty.
  void Score(const Voters& voters, const std::vector<char>& wanted,
             std::vector<float>* scores) const;
  [[nodiscard]] std::size_t num_bytes() const;

 private:
  // Calls visit(landmark, weight) for the landmarks that look like a keypoint.
  template <typename Visit>
  void ForEachAlike(const MapTile& tile, const Voters& voters, std::size_t keypoint,
                    const Visit& visit) const;
  [[nodiscard]] std::vector<float> Count(std::vector<std::vector<struct Vote>> votes) const;
  struct ViewPose {
    Eigen::Matrix3f cam_from_map;  // directions; the map's point scale does not matter to angles
    Eigen::Vector3f centre;        // metres from the origin
  };
  void AddWords(const MapTile& tile, std::span<const std::uint32_t> words);
  void AddViews(const MapTile& tile, const LocalFrame& local);
  void AddView(std::uint32_t view_idx, const LocalFrame& local);
  // Rows of `landmarks_of_word_`: first and behind the last.
  [[nodiscard]] std::pair<std::uint32_t, std::uint32_t> RowsOf(std::uint32_t word) const;
  // `across_rad` and `up_rad` are the angles of the keypoint's ray.
  void VoteFor(const MapTile& tile, const Voters& voters, std::size_t keypoint, double across_rad,
               double up_rad, std::uint32_t landmark, float weight, const std::vector<char>& wanted,
               std::vector<struct Vote>* votes) const;

  const MapBundle& bundle_;
  const std::size_t tile_;
  VoteOptions options_;
  // Landmarks and views count within the tile.
  // Words ascending; none where most are there: then each word has its row.
  std::vector<std::uint32_t> words_, word_offsets_, landmarks_of_word_;
  std::vector<std::uint8_t> angles_;  // codes, in the order of landmarks_of_word_
  std::vector<std::uint32_t> view_offsets_, views_of_landmark_;
  std::vector<Rigid3> local_from_anchor_;
  std::vector<ViewPose> poses_;
  std::vector<float> norm_;  // of each view: views with many landmarks gather more by chance
};

}  // namespace panofix
