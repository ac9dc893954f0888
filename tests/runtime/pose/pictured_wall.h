#pragma once
// A wall with a picture on it, before one panorama: a bundle that keeps its views' images.

#include <memory>

#include "common/features/features.h"
#include "common/map/map_bundle.h"
#include "runtime/pose/frame_matches.h"
#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"

namespace panofix {

inline constexpr double kWallDistance_m = 10;

// One panorama with three views of the same busy wall 10 m ahead of each; view 0 shows its SIFT
// features as landmarks, exact; the others show none.
class PicturedWall {
 public:
  PicturedWall();
  [[nodiscard]] const std::shared_ptr<const MapBundle>& bundle() const { return bundle_; }
  [[nodiscard]] const Camera& camera() const { return bundle_->manifest().camera; }
  [[nodiscard]] const GrayImage& image() const { return image_; }
  [[nodiscard]] LocalFrame local() const { return LocalFrame::At(bundle_->panoramas()[0]); }
  // What a camera at the panorama sees in view 0's direction: keypoint i is landmark i.
  [[nodiscard]] const FrameFeatures& frame() const { return frame_; }

 private:
  TempFolder folder_;
  GrayImage image_;
  FrameFeatures frame_;
  std::shared_ptr<const MapBundle> bundle_;
};

}  // namespace panofix
