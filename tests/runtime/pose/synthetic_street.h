#pragma once
// A street of exact landmarks as a bundle, and frames taken in it: what retrieval and matching are
// worth is not at stake here, only what is done with their results.

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common/base/rng.h"
#include "runtime/pose/pose_estimator.h"
#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"

namespace panofix {

struct StreetLandmark {
  Eigen::Vector3d position;  // in the street's frame: x right, y along, z up, true metres
  double size_m = 0;         // of what its keypoint covers
  float angle_deg = 0;       // of its keypoint in an upright picture
  std::uint8_t surface_idx = 0;
  std::vector<std::uint8_t> descriptor;
};

// kTwins: two walls whose first 32 m are repeated for ever: places 32 m apart look the same.
enum class StreetShape { kTwoWalls, kOneWall, kLine, kTwins };
inline constexpr double kTwinPeriod_m = 32;

// What the map says of its landmarks and walls.
inline constexpr double kStreetPointSigma_m = 0.02, kStreetShareSigma = 0.02,
                        kStreetNormalSigma_rad = 0.005;
inline constexpr std::uint32_t kStreetPanoramas = 6,
                               kStreetViews = 8;  // panoramas; views a station

// Panoramas every 8 m along y, 2.5 m high, in a grid whose point scale is not one, each with a
// virtual station 4 m on; walls 7 m to each side. Every landmark is in the map once, anchored at
// the panorama nearest to it, and shown by all views within 30 m that look at it. Descriptors are
// packed.
class SyntheticStreet {
 public:
  // `change` is done to the bundle before it is written.
  explicit SyntheticStreet(StreetShape shape, int num_landmarks = 600,
                           const std::function<void(CraftedBundle*)>& change = {});
  [[nodiscard]] const std::shared_ptr<const MapBundle>& bundle() const { return bundle_; }
  [[nodiscard]] const Camera& camera() const { return bundle_->manifest().camera; }
  [[nodiscard]] const StationGrid& stations() const { return *stations_; }
  // A frame of the street that equals LocalFrame::At(panorama 0) but for the panorama's height.
  [[nodiscard]] const LocalFrame& local() const { return local_; }
  // Pose of a camera `heading_deg` clockwise from the street's direction.
  [[nodiscard]] Rigid3 CamFromLocal(const Eigen::Vector3d& position_in_street,
                                    double heading_deg) const;
  // What a camera sees there, with pixel noise, changed descriptors and `num_clutter` strangers.
  [[nodiscard]] FrameFeatures Frame(const Rigid3& cam_from_local, double pixel_sigma,
                                    int num_clutter) const;
  // Matches of the views of panoramas [first, last] that have any.
  [[nodiscard]] std::vector<ViewMatches> Match(const FrameFeatures& frame, std::uint32_t first,
                                               std::uint32_t last) const;
  // Refers to the arguments and to this street.
  [[nodiscard]] PoseContext Context(const FrameFeatures& frame, const PoseOptions& options) const {
    return {frame, camera(), *bundle_, stations(), local_, options, nullptr};
  }

 private:
  [[nodiscard]] Rigid3 LocalFromStreet() const;
  std::vector<StreetLandmark> landmarks_;
  TempFolder folder_;
  std::shared_ptr<const MapBundle> bundle_;
  std::unique_ptr<const StationGrid> stations_;
  LocalFrame local_;
};

// One with two walls, made once for all tests of a program.
[[nodiscard]] const SyntheticStreet& Street();

}  // namespace panofix
