#include "common/map/tile_cache.h"

#include <fcntl.h>
#include <tbb/parallel_for.h>

#include "common/base/cancel.h"
#include "common/base/log.h"
#include "common/io/sealed_copy.h"
#include "common/map/bundle_files.h"

namespace panofix {
namespace {

// The disk is at work on so many tiles while others are hashed.
constexpr std::size_t kTilesAhead = 8;

}  // namespace

Result<MapTile> TileCache::Read(const Entry& entry) const {
  const auto copy = CopyVerifiedPart(entry.fd.get(), entry.part, entry.name);
  if (!copy.ok()) return copy.status();
  return parse_(copy->get(), entry.name);
}

void TileCache::Add(const BundlePart& part, UniqueFd fd, const std::string& name) {
  Entry& entry = entries_.emplace_back();
  entry.part = part, entry.fd = std::move(fd), entry.name = name;
}

std::vector<Status> TileCache::ReadFirst(std::size_t begin, std::size_t end) {
  std::vector<Status> results(end - begin);
  std::atomic<std::size_t> failed{end};  // the first that did so far
  const auto range = tbb::blocked_range<std::size_t>(begin, end, 1);
  const auto read = [&](std::size_t tile) {
    if (tile > failed || CancelRequested()) return;
    if (tile + kTilesAhead < end) Announce(tile + kTilesAhead);
    Status& result = results[tile - begin];
    result = ReadFirst(tile);
    if (result.ok()) return;
    for (std::size_t first = failed; tile < first;) {
      if (failed.compare_exchange_weak(first, tile)) break;
    }
  };
  tbb::parallel_for(
      range,
      [&](const tbb::blocked_range<std::size_t>& tiles) {
        for (std::size_t tile = tiles.begin(); tile < tiles.end(); ++tile) read(tile);
      },
      tbb::simple_partitioner());
  return results;
}

void TileCache::Announce(std::size_t tile) const {
  // Advice: what comes of it is told by reading.
  static_cast<void>(::posix_fadvise(entries_[tile].fd.get(), 0, 0, POSIX_FADV_WILLNEED));
}

Status TileCache::ReadFirst(std::size_t tile) {
  Entry& entry = entries_[tile];
  auto read = Read(entry);
  if (!read.ok()) return read.status();
  entry.num_views = read->num_views();
  entry.tile = std::make_unique<const MapTile>(std::move(*read));
  entry.loaded.store(entry.tile.get(), std::memory_order_release);
  ++num_loads_;
  num_loaded_bytes_ += num_bytes(tile);
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
