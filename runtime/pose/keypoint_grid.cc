#include "runtime/pose/keypoint_grid.h"

#include <algorithm>
#include <cmath>

namespace panofix {
namespace {

// In [0, 360).
float WrappedDeg(double angle_deg) {
  const auto wrapped = static_cast<float>(angle_deg - 360 * std::floor(angle_deg / 360));
  return wrapped >= 360 ? 0 : wrapped;  // it may round up; NaN stays
}

}  // namespace

int KeypointGrid::CellOf(double v_px, int count) {
  if (!(v_px > 0)) return 0;  // also NaN
  return static_cast<int>(std::min(v_px / kCell_px, static_cast<double>(count - 1)));
}

KeypointGrid::KeypointGrid(const FeatureSet& features, const Camera& camera)
    : columns_(camera.width_px / kCell_px + 1),
      rows_(camera.height_px / kCell_px + 1),
      offsets_(static_cast<std::size_t>(columns_ * rows_) + 1, 0),
      entries_(features.size()),
      keypoints_(features.size()) {
  const auto cell_of = [&](const Keypoint& k) {
    return static_cast<std::size_t>(CellOf(double{k.y_px}, rows_) * columns_ +
                                    CellOf(double{k.x_px}, columns_));
  };
  for (const Keypoint& k : features.keypoints) ++offsets_[cell_of(k) + 1];
  for (std::size_t i = 1; i < offsets_.size(); ++i) offsets_[i] += offsets_[i - 1];
  std::vector<std::uint32_t> next(offsets_.begin(), offsets_.end() - 1);
  for (std::size_t i = 0; i < features.size(); ++i) {
    const Keypoint& k = features.keypoints[i];
    const std::uint32_t slot = next[cell_of(k)]++;
    entries_[slot] = {k.x_px, k.y_px, k.size_px, WrappedDeg(double{k.angle_deg})};
    keypoints_[slot] = static_cast<int>(i);
  }
}

void KeypointGrid::Within(const Eigen::Vector2d& px, double radius_px, const KeypointShape& shape,
                          std::vector<int>* found) const {
  found->clear();
  const int x0 = CellOf(px.x() - radius_px, columns_), x1 = CellOf(px.x() + radius_px, columns_);
  const int y0 = CellOf(px.y() - radius_px, rows_), y1 = CellOf(px.y() + radius_px, rows_);
  const auto x = static_cast<float>(px.x()), y = static_cast<float>(px.y());
  const auto radius_sq = static_cast<float>(radius_px * radius_px);
  const auto min_size = static_cast<float>(shape.min_size_px),
             max_size = static_cast<float>(shape.max_size_px);
  const float angle = WrappedDeg(shape.angle_deg),
              max_turn = static_cast<float>(shape.max_turn_deg);
  for (int row = y0; row <= y1; ++row) {
    const std::uint32_t begin = offsets_[static_cast<std::size_t>(row * columns_ + x0)],
                        end = offsets_[static_cast<std::size_t>(row * columns_ + x1 + 1)];
    // No branch on what fits: it could not be predicted.
    std::size_t size = found->size();
    found->resize(size + (end - begin));
    for (std::uint32_t slot = begin; slot < end; ++slot) {
      const Entry& e = entries_[slot];
      const float dx = e.x_px - x, dy = e.y_px - y, turn = std::abs(e.angle_deg - angle);
      const bool fits = (dx * dx + dy * dy <= radius_sq) & (e.size_px >= min_size) &
                        (e.size_px <= max_size) & (std::min(turn, 360 - turn) <= max_turn);
      (*found)[size] = keypoints_[slot];
      size += fits ? 1 : 0;
    }
    found->resize(size);
  }
}

}  // namespace panofix
