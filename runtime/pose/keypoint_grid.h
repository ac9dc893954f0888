#pragma once
// A frame's keypoints by image cell, for window queries.

#include <cstdint>
#include <limits>
#include <vector>

#include "common/camera/camera.h"
#include "common/features/features.h"

namespace panofix {

// What keypoints are looked for, descriptors apart. The default is any.
struct KeypointShape {
  double min_size_px = 0, max_size_px = std::numeric_limits<float>::max();
  double angle_deg = 0, max_turn_deg = 360;
};

class KeypointGrid {
 public:
  KeypointGrid(const FeatureSet& features, const Camera& camera);
  // Replaces `*found` by the keypoints within `radius_px` that are shaped as told, cell by cell;
  // compared in floats.
  void Within(const Eigen::Vector2d& px, double radius_px, const KeypointShape& shape,
              std::vector<int>* found) const;

 private:
  static constexpr int kCell_px = 16;
  struct Entry {
    float x_px = 0, y_px = 0, size_px = 0, angle_deg = 0;  // angle in [0, 360)
  };
  [[nodiscard]] static int CellOf(double v_px, int count);
  int columns_ = 0, rows_ = 0;
  std::vector<std::uint32_t> offsets_;  // of a cell's entries; cells of a row follow each other
  std::vector<Entry> entries_;
  std::vector<int> keypoints_;  // of the entries
};

}  // namespace panofix
