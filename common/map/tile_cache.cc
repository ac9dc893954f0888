#include "common/map/tile_cache.h"

#include "common/base/log.h"
#include "common/io/sealed_copy.h"
#include "common/map/bundle_files.h"

namespace panofix {

Result<MapTile> TileCache::Read(const Entry& entry) const {
  const auto copy = CopyVerifiedPart(entry.fd.get(), entry.part, entry.name);
  if (!copy.ok()) return copy.status();
  return parse_(copy->get(), entry.name);
}

Status TileCache::Add(const BundlePart& part, UniqueFd fd, const std::string& name,
                      const Parse& parse) {
  parse_ = parse;
  Entry& entry = entries_.emplace_back();
  entry.part = part, entry.fd = std::move(fd), entry.name = name;
  auto tile = Read(entry);
  if (!tile.ok()) return tile.status();
  entry.num_views = tile->num_views();
  entry.tile = std::make_unique<const MapTile>(std::move(*tile));
  entry.loaded = entry.tile.get();
  ++num_loads_;
  num_loaded_bytes_ += num_bytes(entries_.size() - 1);
  return {};
}

const MapTile& TileCache::Load(std::size_t tile) const {
  const Entry& entry = entries_[tile];
  const std::lock_guard lock(entry.mutex);
  if (const MapTile* loaded = entry.loaded.load(std::memory_order_acquire)) return *loaded;
  auto read = Read(entry);
  if (!read.ok()) {
    Log(LogLevel::kError, read.status().message() + "; the map goes without this tile");
    ++num_failed_;
  }
  entry.tile = std::make_unique<const MapTile>(read.ok() ? std::move(*read)
                                                         : MapTile::Blank(entry.num_views));
  num_loaded_bytes_ += num_bytes(tile);
  ++num_loads_;
  entry.loaded.store(entry.tile.get(), std::memory_order_release);
  return *entry.tile;
}

void TileCache::Drop(std::size_t tile) const {
  const Entry& entry = entries_[tile];
  const std::lock_guard lock(entry.mutex);
  // A failed tile is not tried again: who asked it before must find the same.
  if (entry.tile == nullptr || (entry.tile->num_landmarks() == 0)) return;
  entry.loaded = nullptr;
  entry.tile.reset();
  num_loaded_bytes_ -= num_bytes(tile);
}

std::uint64_t TileCache::num_bytes(std::size_t tile) const { return entries_[tile].part.num_bytes; }

}  // namespace panofix
