#include "builder/pipeline/source_cache.h"

#include <algorithm>

#include "builder/extract/panorama_features.h"

namespace panofix {

std::shared_ptr<const RenderSource> SourceCache::Get(std::uint32_t panorama_idx,
                                                     const PanoramaRecord& record) {
  std::promise<Content> promise;
  std::shared_future<Content> future;
  bool is_new = false;
  {
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(panorama_idx);
    is_new = found == entries_.end();
    future = is_new ? promise.get_future().share() : found->second;
    if (is_new) entries_.emplace(panorama_idx, future);
    recent_.remove(panorama_idx);
    recent_.push_front(panorama_idx);
    if (recent_.size() > kMostKept) {
      entries_.erase(recent_.back());  // who uses it holds it
      recent_.pop_back();
    }
  }
  if (is_new) promise.set_value(Load(record));
  return future.get();
}

SourceCache::Content SourceCache::Load(const PanoramaRecord& record) const {
  // Nearer to a wall than the panorama was, a view shows more than its own resolution of it.
  constexpr double kFiner = 1.4;
  Camera finer = view_camera_;
  finer.fx_px *= kFiner, finer.fy_px *= kFiner;
  std::string fault;
  auto depth = ReadUsableDepth(record, &fault);
  auto image = DecodePanorama(record.image, finer);
  auto mask = ReadMask(record);
  if (!depth || !image.ok() || !mask.ok()) return nullptr;
  return std::make_shared<const RenderSource>(std::move(image).value(), std::move(mask).value(),
                                              std::move(*depth));
}

}  // namespace panofix
