// Tiles while memory runs out: whoever asks is told, and nobody waits for ever.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <new>
#include <thread>

#include "common/base/log.h"
#include "runtime/retrieval/tile_indices.h"
#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"

namespace {

// What is larger than this cannot be had while memory is out.
constexpr std::size_t kLeft_bytes = 256;
std::atomic<bool> is_out{false};
std::atomic<int> num_refused{0};

}  // namespace

// Never inlined: the compiler would see free() where it expects delete.
[[gnu::noinline]] void* operator new(std::size_t num_bytes) {
  if (is_out && num_bytes > kLeft_bytes) {
    ++num_refused;
    throw std::bad_alloc();
  }
  if (void* memory = std::malloc(num_bytes > 0 ? num_bytes : 1)) return memory;
  throw std::bad_alloc();
}
// std::stable_sort's; what one of these takes, the others free.
[[gnu::noinline]] void* operator new(std::size_t num_bytes, const std::nothrow_t&) noexcept {
  return std::malloc(num_bytes > 0 ? num_bytes : 1);
}
[[gnu::noinline]] void operator delete(void* memory) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

namespace panofix {
namespace {

class MemoryOutTest : public testing::Test {
 protected:
  void SetUp() override {
    SetLogLevel("off");
    SmallBundle().Write(folder_ / "b");
    bundle_ = ValueOrThrow(MapBundle::Open(folder_ / "b"));
  }
  void TearDown() override { is_out = false; }
  const TempFolder folder_;
  std::shared_ptr<const MapBundle> bundle_;
};

TEST_F(MemoryOutTest, ATileThatCouldNotBeDerivedIsTriedAgain) {
  constexpr std::uint64_t kNothing_bytes = 1;  // no tile is kept
  TileIndices indices(bundle_, true, kNothing_bytes, [] { return std::uint64_t{0}; });
  is_out = true;
  EXPECT_THROW(static_cast<void>(indices.Of(0)), std::bad_alloc);
  is_out = false;
  EXPECT_NE(indices.Of(0), nullptr);
}

TEST_F(MemoryOutTest, LoadingAheadGoesOn) {
  constexpr std::uint64_t kEnough_bytes = std::uint64_t{1} << 40;
  std::uint64_t beside_bytes = 2 * kEnough_bytes;  // until the tiles have been dropped
  TileIndices indices(bundle_, true, kEnough_bytes, [&] { return beside_bytes; });
  ASSERT_FALSE(bundle_->tiles().IsLoaded(0));
  beside_bytes = 0;
  num_refused = 0;
  is_out = true;
  indices.Follow({0, 0, 0}, {0, 1, 0});
  const auto eventually = [](const auto& condition) {
    for (int i = 0; i < 20'000 && !condition(); ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return condition();
  };
  EXPECT_TRUE(eventually([] { return num_refused > 0; }));
  is_out = false;
  EXPECT_TRUE(eventually([&] {
    indices.Follow({0, 0, 0}, {0, 1, 0});
    return indices.memory().num_loaded > 0;
  }));
}

}  // namespace
}  // namespace panofix
