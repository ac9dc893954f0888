#include "runtime/pose/make_in_order.h"

#include <gtest/gtest.h>

#include <atomic>

namespace panofix {
namespace {

std::vector<int> Taken(std::size_t count, std::size_t num_wanted, std::size_t num_threads) {
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, num_threads);
  std::vector<int> taken;
  MakeInOrder<int>(
      count, [&] { return taken.size() < num_wanted; },
      [](std::size_t i) { return static_cast<int>(10 * i + 1); },
      [&](int made) { taken.push_back(made); });
  return taken;
}

TEST(MakeInOrder, TakesTheSameForAnyNumberOfThreads) {
  for (const std::size_t num_threads : {1, 2, 3, 16}) {
    EXPECT_EQ(Taken(5, 9, num_threads), (std::vector<int>{1, 11, 21, 31, 41})) << num_threads;
    EXPECT_EQ(Taken(5, 5, num_threads), (std::vector<int>{1, 11, 21, 31, 41})) << num_threads;
    EXPECT_EQ(Taken(5, 3, num_threads), (std::vector<int>{1, 11, 21})) << num_threads;
    EXPECT_EQ(Taken(5, 1, num_threads), (std::vector<int>{1})) << num_threads;
    EXPECT_TRUE(Taken(5, 0, num_threads).empty()) << num_threads;
    EXPECT_TRUE(Taken(0, 3, num_threads).empty()) << num_threads;
  }
}

TEST(MakeInOrder, OneThreadMakesNothingInVain) {
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
  std::atomic<int> num_made = 0;
  int num_taken = 0;
  MakeInOrder<int>(
      9, [&] { return num_taken < 4; }, [&](std::size_t) { return ++num_made; },
      [&](int) { ++num_taken; });
  EXPECT_EQ(num_made, 4);
}

}  // namespace
}  // namespace panofix
