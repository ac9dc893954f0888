#include "runtime/pose/view_image_cache.h"

#include <stdexcept>

namespace panofix {

ViewImageCache::ViewImageCache(std::shared_ptr<const MapBundle> bundle, std::size_t capacity)
    : bundle_(std::move(bundle)), capacity_(capacity) {
  if (capacity == 0) throw std::invalid_argument("capacity = 0; must be at least 1");
}

Result<std::shared_ptr<const GradientPyramid>> ViewImageCache::Get(std::uint32_t view_idx) {
  {
    const std::scoped_lock lock(mutex_);
    const auto found = entry_of_.find(view_idx);
    if (found != entry_of_.end()) {
      entries_.splice(entries_.begin(), entries_, found->second);
      return found->second->pyramid;
    }
  }
  const auto image = bundle_->ViewImage(view_idx);
  if (!image.ok()) return image.status();
  Pyramid pyramid = std::make_shared<const GradientPyramid>(*image);
  const std::scoped_lock lock(mutex_);
  ++num_computed_;
  if (entry_of_.count(view_idx) > 0) return pyramid;  // another thread was faster
  entries_.push_front({view_idx, pyramid});
  entry_of_[view_idx] = entries_.begin();
  if (entries_.size() > capacity_) {
    entry_of_.erase(entries_.back().view_idx);
    entries_.pop_back();
  }
  return pyramid;
}

std::size_t ViewImageCache::size() const {
  const std::scoped_lock lock(mutex_);
  return entries_.size();
}

std::size_t ViewImageCache::num_computed() const {
  const std::scoped_lock lock(mutex_);
  return num_computed_;
}

}  // namespace panofix
