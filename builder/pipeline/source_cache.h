#pragma once
// Panoramas made ready for rendering, each once for all its neighbours.

#include <cstdint>
#include <future>
#include <list>
#include <map>
#include <memory>
#include <mutex>

#include "builder/augment/view_renderer.h"
#include "builder/ingest/panorama_set.h"

namespace panofix {

// Keeps the most recently used ones. Thread-safe.
class SourceCache {
 public:
  explicit SourceCache(const Camera& view_camera) : view_camera_(view_camera) {}
  // Null where the panorama has no usable image or depth: the extraction said so.
  [[nodiscard]] std::shared_ptr<const RenderSource> Get(std::uint32_t panorama_idx,
                                                        const PanoramaRecord& record);

 private:
  using Content = std::shared_ptr<const RenderSource>;
  static constexpr std::size_t kMostKept = 10;  // some 30 MB each
  [[nodiscard]] Content Load(const PanoramaRecord& record) const;

  const Camera view_camera_;
  std::mutex mutex_;
  std::map<std::uint32_t, std::shared_future<Content>> entries_;
  std::list<std::uint32_t> recent_;  // most recent first
};

}  // namespace panofix
