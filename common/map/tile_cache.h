#pragma once
// The tiles of an open bundle: in memory while they are wanted; after they were dropped, read and
// verified again when they are next asked for.

#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "common/io/unique_fd.h"
#include "common/map/manifest.h"
#include "common/map/map_tile.h"

namespace panofix {

class TileCache {
 public:
  // Makes a tile of a verified file.
  using Parse = std::function<Result<MapTile>(int fd, const std::string& name)>;

  explicit TileCache(Parse parse) : parse_(std::move(parse)) {}

  // One tile more, of the file behind `fd`, which is kept: a file that is deleted later can be read
  // on. Nothing is read yet. Not thread-safe.
  void Add(const BundlePart& part, UniqueFd fd, const std::string& name);
  // Reads the tiles [begin, end) for the first time, TBB over them: kChecksumMismatch, and what
  // `parse` says. Only then may they be asked for. One status a tile; those behind the first that
  // failed, or after Ctrl-C, may not have been read.
  [[nodiscard]] std::vector<Status> ReadFirst(std::size_t begin, std::size_t end);

  [[nodiscard]] std::size_t size() const { return entries_.size(); }
  // Reads it where it is not in memory. One that cannot be read any more, or has changed, counts as
  // failed: an error in the log, and a tile of as many views without a landmark from then on.
  [[nodiscard]] const MapTile& Get(std::size_t tile) const {
    const MapTile* loaded = entries_[tile].loaded.load(std::memory_order_acquire);
    return loaded != nullptr ? *loaded : Load(tile);
  }
  [[nodiscard]] bool IsLoaded(std::size_t tile) const {
    return entries_[tile].loaded.load(std::memory_order_acquire) != nullptr;
  }
  // REQUIRES: nobody uses the tile or a span of it.
  void Drop(std::size_t tile) const;

  // Memory that the tile takes while it is loaded, and that all loaded ones take.
  [[nodiscard]] std::uint64_t num_bytes(std::size_t tile) const;
  [[nodiscard]] std::uint64_t num_loaded_bytes() const { return num_loaded_bytes_; }
  // Since the bundle was opened, the first time included.
  [[nodiscard]] std::int64_t num_loads() const { return num_loads_; }
  [[nodiscard]] std::int64_t num_failed() const { return num_failed_; }

 private:
  struct Entry {
    BundlePart part;
    UniqueFd fd;
    std::string name;
    std::size_t num_views = 0;
    mutable std::mutex mutex;  // held while it is read
    mutable std::unique_ptr<const MapTile> tile;
    mutable std::atomic<const MapTile*> loaded{nullptr};
  };
  // Asks the system to have the tile's file ready soon.
  void Announce(std::size_t tile) const;
  [[nodiscard]] Status ReadFirst(std::size_t tile);
  [[nodiscard]] Result<MapTile> Read(const Entry& entry) const;
  [[nodiscard]] const MapTile& Load(std::size_t tile) const;

  std::deque<Entry> entries_;
  const Parse parse_;
  mutable std::atomic<std::uint64_t> num_loaded_bytes_{0};
  mutable std::atomic<std::int64_t> num_loads_{0}, num_failed_{0};
};

}  // namespace panofix
