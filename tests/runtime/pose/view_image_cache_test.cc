#include "runtime/pose/view_image_cache.h"

#include <gtest/gtest.h>

#include <stdexcept>

#include "tests/runtime/pose/pictured_wall.h"

namespace panofix {
namespace {

TEST(ViewImageCache, ComputesAViewOnce) {
  const PicturedWall wall;
  ViewImageCache cache(wall.bundle(), 2);
  const auto first = cache.Get(0);
  ASSERT_TRUE(first.ok()) << first.status().message();
  const auto again = cache.Get(0);
  ASSERT_TRUE(again.ok());
  EXPECT_EQ(*first, *again);
  EXPECT_EQ(cache.num_computed(), 1U);
}

TEST(ViewImageCache, ForgetsTheLeastRecentlyUsed) {
  const PicturedWall wall;
  ViewImageCache cache(wall.bundle(), 2);
  for (const std::uint32_t view : {0U, 1U, 0U, 2U}) EXPECT_TRUE(cache.Get(view).ok());
  EXPECT_EQ(cache.size(), 2U);
  EXPECT_EQ(cache.num_computed(), 3U);
  EXPECT_TRUE(cache.Get(0).ok());  // used after 1: kept
  EXPECT_EQ(cache.num_computed(), 3U);
  EXPECT_TRUE(cache.Get(1).ok());  // gone
  EXPECT_EQ(cache.num_computed(), 4U);
  EXPECT_EQ(cache.size(), 2U);
}

TEST(ViewImageCache, FailuresAreNotKept) {
  const TempFolder folder;
  SmallBundle().Write(folder / "b");
  ViewImageCache cache(ValueOrThrow(MapBundle::Open(folder / "b")), 2);
  EXPECT_EQ(cache.Get(0).status().code(), ErrorCode::kNotFound);
  EXPECT_EQ(cache.size(), 0U);
  EXPECT_THROW(ViewImageCache(nullptr, 0), std::invalid_argument);
}

}  // namespace
}  // namespace panofix
