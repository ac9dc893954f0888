#include "runtime/retrieval/tile_indices.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <limits>

#include "common/base/cancel.h"
#include "common/base/log.h"

namespace panofix {
namespace {

// Landmarks are used some tens of metres around a station.
constexpr double kNear_m = 100;

// Points of the way that a tile's distance is measured from.
constexpr int kWaySteps = 4;

// Trimming goes this share below the bound, so that not every frame has to.
constexpr std::uint64_t kSlack = 32;

}  // namespace

TileIndices::TileIndices(std::shared_ptr<const MapBundle> bundle, bool use_landmarks,
                         std::uint64_t max_memory_bytes,
                         std::function<std::uint64_t()> memory_beside_tiles)
    : bundle_(std::move(bundle)),
      use_landmarks_(use_landmarks),
      max_memory_bytes_(max_memory_bytes),
      memory_beside_tiles_(std::move(memory_beside_tiles)),
      local_(LocalFrame::At(bundle_->panoramas().front())),
      slots_(bundle_->tiles().size()) {
  for (std::size_t v = 0; v < bundle_->views().size(); ++v) {
    const MapPanorama& panorama = bundle_->panoramas()[bundle_->views()[v].panorama_idx];
    slots_[bundle_->TileOfView(v)].extent_in_map.extend(
        panorama.map_from_pano.translation.head<2>().eval());
  }
  const auto derive = [&](std::size_t tile) {
    if (!CancelRequested()) static_cast<void>(Of(tile));
  };
  if (max_memory_bytes_ == 0) {
    tbb::parallel_for(std::size_t{0}, slots_.size(), derive);
    return;
  }
  // One by one: what is there at once is what the bound is for.
  for (std::size_t tile = 0; tile < slots_.size(); ++tile) {
    slots_[tile].distance_m = static_cast<double>(tile);  // until there is a way
    derive(tile);
    Trim();
  }
  loader_ = std::thread([this] { LoadAhead(); });
}

TileIndices::~TileIndices() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  changed_.notify_all();
  if (loader_.joinable()) loader_.join();
}

std::shared_ptr<const TileIndex> TileIndices::Derive(std::size_t tile_idx) {
  const MapTile& tile = bundle_->tiles().Get(tile_idx);
  std::vector<BagOfWords> bags;
  for (std::size_t slot = 0; slot < tile.num_views(); ++slot) bags.push_back(tile.Bag(slot));
  auto index = std::make_shared<TileIndex>(TileIndex{InvertedIndex(bags), {}});
  if (!use_landmarks_) return index;
  std::span<const std::uint32_t> words = tile.words();
  if (words.empty()) {
    // Nobody else writes them while the slot is busy.
    std::vector<std::uint32_t>& derived = slots_[tile_idx].words;
    if (derived.empty()) derived = tile.DeriveWords(bundle_->vocabulary().sift);
    words = derived;
  }
  index->votes.emplace(*bundle_, tile_idx, words, local_, VoteOptions{});
  return index;
}

std::shared_ptr<const TileIndex> TileIndices::Of(std::size_t tile) {
  std::unique_lock lock(mutex_);
  Slot& slot = slots_[tile];
  changed_.wait(lock, [&] { return slot.state != State::kBusy; });
  if (slot.state == State::kReady) return slot.index;
  slot.state = State::kBusy;
  lock.unlock();
  std::shared_ptr<const TileIndex> index;
  try {
    index = Derive(tile);
  } catch (...) {
    // Others wait for it; the next to ask tries again.
    lock.lock();
    slot.state = State::kAbsent;
    lock.unlock();
    changed_.notify_all();
    throw;
  }
  lock.lock();
  slot.index = index;
  slot.num_bytes = bundle_->tiles().num_bytes(tile) + index->num_bytes();
  slot.state = State::kReady;
  lock.unlock();
  changed_.notify_all();
  return index;
}

void TileIndices::Follow(const Eigen::Vector3d& here_in_map, const Eigen::Vector3d& ahead_in_map) {
  if (max_memory_bytes_ == 0 || !here_in_map.allFinite() || !ahead_in_map.allFinite()) return;
  {
    const std::lock_guard lock(mutex_);
    ahead_.clear();
    for (std::size_t tile = 0; tile < slots_.size(); ++tile) {
      double& distance_m = slots_[tile].distance_m;
      distance_m = std::numeric_limits<double>::infinity();
      for (int step = 0; step <= kWaySteps; ++step) {
        const Eigen::Vector3d at =
            here_in_map + (ahead_in_map - here_in_map) * (static_cast<double>(step) / kWaySteps);
        distance_m =
            std::min(distance_m, slots_[tile].extent_in_map.exteriorDistance(at.head<2>().eval()));
      }
      if (distance_m < kNear_m && slots_[tile].state == State::kAbsent) ahead_.push_back(tile);
    }
    std::sort(ahead_.begin(), ahead_.end(), [&](std::size_t a, std::size_t b) {
      return std::make_pair(slots_[a].distance_m, a) < std::make_pair(slots_[b].distance_m, b);
    });
  }
  changed_.notify_all();
}

bool TileIndices::WouldStay(std::size_t tile) const {
  const TileCache& tiles = bundle_->tiles();
  const std::uint64_t taken =
      memory_beside_tiles_() + tiles.num_loaded_bytes() + slots_[tile].num_bytes;
  if (taken <= max_memory_bytes_) return true;
  // Those farther away go first.
  std::uint64_t worse = 0;
  for (std::size_t other = 0; other < slots_.size(); ++other) {
    if (tiles.IsLoaded(other) && slots_[other].distance_m > slots_[tile].distance_m)
      worse += slots_[other].num_bytes;
  }
  return taken + max_memory_bytes_ / kSlack <= max_memory_bytes_ + worse;
}

void TileIndices::LoadAhead() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [&] { return stop_ || !ahead_.empty(); });
    if (stop_) return;
    const std::size_t tile = ahead_.front();
    ahead_.erase(ahead_.begin());
    if (!WouldStay(tile)) {
      ahead_.clear();  // the others are farther away still
      continue;
    }
    lock.unlock();
    try {
      static_cast<void>(Of(tile));
    } catch (const std::exception& error) {
      // A frame that needs the tile tries again, and says so.
      LogWarning(Format("tile %zu is not loaded ahead: %s", tile, error.what()));
    }
    lock.lock();
  }
}

void TileIndices::Drop(std::size_t tile) {
  Slot& slot = slots_[tile];
  slot.index.reset();
  slot.state = State::kAbsent;
  bundle_->tiles().Drop(tile);
}

void TileIndices::Trim() {
  if (max_memory_bytes_ == 0) return;
  // Tiles' pages count whether they were touched or not.
  const std::uint64_t taken = memory_beside_tiles_() + bundle_->tiles().num_loaded_bytes();
  if (taken <= max_memory_bytes_) return;
  std::uint64_t excess = taken - max_memory_bytes_ + max_memory_bytes_ / kSlack;
  const std::lock_guard lock(mutex_);
  std::vector<std::size_t> order;
  for (std::size_t tile = 0; tile < slots_.size(); ++tile) {
    if (slots_[tile].state != State::kBusy && bundle_->tiles().IsLoaded(tile))
      order.push_back(tile);
  }
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return std::make_pair(slots_[a].distance_m, a) > std::make_pair(slots_[b].distance_m, b);
  });
  for (const std::size_t tile : order) {
    const std::uint64_t freed =
        bundle_->tiles().num_bytes(tile) +
        (slots_[tile].index ? slots_[tile].index->num_bytes() : std::size_t{0});
    Drop(tile);
    if (freed >= excess) break;
    excess -= freed;
  }
  ReturnFreedMemory();
  const std::uint64_t left = memory_beside_tiles_() + bundle_->tiles().num_loaded_bytes();
  if (is_told_ || left <= max_memory_bytes_) return;
  is_told_ = true;
  LogWarning(
      Format("memory is to stay below %llu MB, but %llu MB are in use with hardly a tile of "
             "the map loaded: the bound does not hold, and every search reads the map again",
             static_cast<unsigned long long>(max_memory_bytes_ >> 20),
             static_cast<unsigned long long>(left >> 20)));
}

TileMemory TileIndices::memory() const {
  const std::lock_guard lock(mutex_);
  const TileCache& tiles = bundle_->tiles();
  TileMemory memory;
  memory.num_tiles = static_cast<std::int64_t>(tiles.size());
  memory.num_loads = tiles.num_loads();
  memory.num_failed = tiles.num_failed();
  memory.num_bytes = tiles.num_loaded_bytes();
  for (std::size_t tile = 0; tile < tiles.size(); ++tile) {
    memory.num_loaded += tiles.IsLoaded(tile) ? 1 : 0;
    if (slots_[tile].index) memory.num_bytes += slots_[tile].index->num_bytes();
  }
  return memory;
}

}  // namespace panofix
