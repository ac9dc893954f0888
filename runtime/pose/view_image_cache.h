#pragma once
// Gradient pyramids of database views' images, for kVLD.

#include <cstdint>
#include <list>
#include <memory>
#include <mutex>
#include <unordered_map>

#include "common/features/kvld.h"
#include "common/map/map_bundle.h"

namespace panofix {

// The least recently used ones go first. Thread-safe; several may be computed at once. What it
// holds never changes a result. About 8 bytes a pixel and view.
class ViewImageCache {
 public:
  // `capacity` > 0 (std::invalid_argument).
  ViewImageCache(std::shared_ptr<const MapBundle> bundle, std::size_t capacity);
  // Computed at the first call. kNotFound, kBadData: as MapBundle::ViewImage.
  [[nodiscard]] Result<std::shared_ptr<const GradientPyramid>> Get(std::uint32_t view_idx);
  [[nodiscard]] std::size_t size() const;
  [[nodiscard]] std::size_t num_computed() const;  // since the start

 private:
  using Pyramid = std::shared_ptr<const GradientPyramid>;
  struct Entry {
    std::uint32_t view_idx;
    Pyramid pyramid;
  };
  const std::shared_ptr<const MapBundle> bundle_;
  const std::size_t capacity_;
  mutable std::mutex mutex_;  // of all below
  std::list<Entry> entries_;  // used last first
  std::unordered_map<std::uint32_t, std::list<Entry>::iterator> entry_of_;
  std::size_t num_computed_ = 0;
};

}  // namespace panofix
