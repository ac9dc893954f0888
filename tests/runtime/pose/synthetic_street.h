#pragma once
// A street of exact landmarks as a bundle, and frames taken in it: what retrieval and matching are
// worth is not at stake here, only what is done with their results.

#include <memory>
#include <string>
#include <vector>

#include "common/base/rng.h"
#include "runtime/pose/frame_matches.h"
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

enum class StreetShape { kTwoWalls, kOneWall, kLine };

// Panoramas every 8 m along y, 2.5 m high, in a grid whose point scale is not one; walls 7 m to
// each side. All landmarks are seen by all panoramas within 30 m whose views show them.
class SyntheticStreet {
 public:
  explicit SyntheticStreet(StreetShape shape, int num_landmarks = 600);
  [[nodiscard]] const std::shared_ptr<const MapBundle>& bundle() const { return bundle_; }
  [[nodiscard]] const Camera& camera() const { return bundle_->manifest().camera; }
  // A frame of the street that equals LocalFrame::At(panorama 0) but for the panorama's height.
  [[nodiscard]] LocalFrame local() const { return LocalFrame::At(bundle_->panoramas()[0]); }
  // Pose of a camera `heading_deg` clockwise from the street's direction.
  [[nodiscard]] Rigid3 CamFromLocal(const Eigen::Vector3d& position_in_street,
                                    double heading_deg) const;
  // What a camera sees there, with pixel noise, changed descriptors and `num_clutter` strangers.
  [[nodiscard]] FrameFeatures Frame(const Rigid3& cam_from_local, double pixel_sigma,
                                    int num_clutter) const;
  // Matches of the views of panoramas [first, last] that have any.
  [[nodiscard]] std::vector<ViewMatches> Match(const FrameFeatures& frame, std::uint32_t first,
                                               std::uint32_t last) const;

 private:
  [[nodiscard]] Rigid3 LocalFromStreet() const;
  std::vector<StreetLandmark> landmarks_;
  TempFolder folder_;
  std::shared_ptr<const MapBundle> bundle_;
};

}  // namespace panofix
