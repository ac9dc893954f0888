#pragma once
// A panorama's plane-coded depth, and its .gsv text. Shares no code with the decoder it tests.

#include <string>
#include <vector>

#include "common/base/rng.h"
#include "tests/town/town.h"

namespace panofix::town {

// n . X = d in the pano frame, metres; entry 0 is unused.
struct PlaneDepth {
  static constexpr int kWidth = 512, kHeight = 256, kMaxPlanes = 255;
  struct Plane {
    Eigen::Vector3d normal = Eigen::Vector3d::Zero();
    double d = 0;
  };
  std::vector<Plane> planes;
  std::vector<std::uint8_t> indices;  // row-major, 0 = no surface
};

// Unit ray of a depth pixel's centre in the pano frame.
[[nodiscard]] Eigen::Vector3d DepthPixelRay(int column, int row);
// Dominant planes as seen from a panorama, the most seen first. Each plane's distance and normal
// err by the options' noise, about the centre of what is seen of it.
[[nodiscard]] PlaneDepth SeePlanes(const Town& town, const Rigid3& town_from_pano, Rng rng);

// The three ways in which such files are found.
struct GsvForm {
  bool zlib = false, url_safe = true, padded = false;
};
[[nodiscard]] std::string EncodeGsv(const PlaneDepth& depth, const GsvForm& form);

}  // namespace panofix::town
