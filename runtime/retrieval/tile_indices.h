#pragma once
// The tiles of a map with what retrieval derives from each, and the bound on the memory of all.

#include <Eigen/Core>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "common/base/memory.h"
#include "common/map/map_bundle.h"
#include "runtime/retrieval/landmark_votes.h"

namespace panofix {

struct TileIndex {
  InvertedIndex words;  // views by their place in the tile
  std::optional<TileVotes> votes;
  [[nodiscard]] std::size_t num_bytes() const {
    return words.num_bytes() + (votes ? votes->num_bytes() : 0);
  }
};

struct TileMemory {
  std::int64_t num_tiles = 0, num_loaded = 0;
  std::int64_t num_loads = 0;   // tiles read since the map was opened, the first time included
  std::int64_t num_failed = 0;  // that could not be read again
  std::uint64_t num_bytes = 0;  // of the loaded ones, indices included
};

// What is derived does not depend on what is in memory: answers are the same for any bound.
class TileIndices {
 public:
  // Looks at every tile once. `max_memory_bytes` bounds what this process takes (0 = no bound):
  // tiles are dropped for it, worst first. What is left without any tile may be above it; the log
  // says so once.
  // `memory_beside_tiles` tells what else is taken.
  TileIndices(std::shared_ptr<const MapBundle> bundle, bool use_landmarks,
              std::uint64_t max_memory_bytes,
              std::function<std::uint64_t()> memory_beside_tiles = PrivateMemoryBytes);
  ~TileIndices();
  TileIndices(const TileIndices&) = delete;
  TileIndices& operator=(const TileIndices&) = delete;

  // Reads and derives what is not in memory. Thread-safe.
  [[nodiscard]] std::shared_ptr<const TileIndex> Of(std::size_t tile);
  // From where the vehicle is, in the map frame, to where it will be some seconds from now: tiles
  // near the way are the last to be dropped, and are loaded ahead by a thread of its own.
  void Follow(const Eigen::Vector3d& here_in_map, const Eigen::Vector3d& ahead_in_map);
  // Drops tiles where memory is above its bound. REQUIRES: nobody but this object's own thread uses
  // the bundle.
  void Trim();
  [[nodiscard]] TileMemory memory() const;

 private:
  enum class State { kAbsent, kBusy, kReady };
  struct Slot {
    State state = State::kAbsent;
    std::shared_ptr<const TileIndex> index;
    // Of its landmarks, where the bundle does not keep them; stay, being costly.
    std::vector<std::uint32_t> words;
    Eigen::AlignedBox2d extent_in_map;
    double distance_m = 0;        // from the way
    std::uint64_t num_bytes = 0;  // with its index, when it was last there
  };
  [[nodiscard]] std::shared_ptr<const TileIndex> Derive(std::size_t tile);
  void Drop(std::size_t tile);
  // Whether a tile would be kept if it were loaded: REQUIRES mutex_ held.
  [[nodiscard]] bool WouldStay(std::size_t tile) const;
  void LoadAhead();

  const std::shared_ptr<const MapBundle> bundle_;
  const bool use_landmarks_;
  const std::uint64_t max_memory_bytes_;
  const std::function<std::uint64_t()> memory_beside_tiles_;
  LocalFrame local_;
  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable changed_;
  bool is_told_ = false;  // that the bound does not hold
  std::vector<Slot> slots_;
  std::vector<std::size_t> ahead_;  // to be loaded, nearest first
  bool stop_ = false;
  std::thread loader_;
};

}  // namespace panofix
