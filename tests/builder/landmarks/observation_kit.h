#pragma once
// Observations made by hand, for tests of one rule at a time.

#include <deque>
#include <vector>

#include "builder/landmarks/landmark_layer.h"

namespace panofix {

using Descriptor = std::array<std::uint8_t, kDescriptorSize>;

// Owns what the observations' spans point to.
class ObservationKit {
 public:
  // Of panorama 0, surface 1, size 0.4 m, angle 10 degrees unless changed through the reference.
  LandmarkObservation& Add(std::uint32_t view, const Eigen::Vector3f& point,
                           const Descriptor& descriptor) {
    descriptors_.push_back(descriptor);
    observations_.push_back({view, 0, 1, point, 0.2F, 0.4F, 10, 0.05F, descriptors_.back()});
    return observations_.back();
  }
  [[nodiscard]] std::vector<LandmarkObservation> observations() const {
    return {observations_.begin(), observations_.end()};
  }

 private:
  std::deque<Descriptor> descriptors_;  // addresses stay
  std::deque<LandmarkObservation> observations_;
};

// Upright panoramas along x, each with a ground and a wall at y = 10 (surfaces 1 and 2).
inline std::vector<LandmarkPanorama> PanoramasAlongX(int count, double spacing_m) {
  std::vector<LandmarkPanorama> panoramas;
  for (int p = 0; p < count; ++p) {
    LandmarkPanorama panorama;
    panorama.local_from_pano.translation = {spacing_m * p, 0, 2.5};
    panorama.planes = {{}, {{0, 0, -1}, 2.5F}, {{0, 1, 0}, 10}};
    panoramas.push_back(panorama);
  }
  return panoramas;
}

inline constexpr double kKitFocal_px = 500;

inline LandmarkLayer BuildFromKit(const ObservationKit& kit, int num_panoramas,
                                  const LandmarkOptions& options) {
  return BuildLandmarks(PanoramasAlongX(num_panoramas, 5), kit.observations(), MapErrors{},
                        kKitFocal_px, options);
}

}  // namespace panofix
