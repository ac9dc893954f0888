#include "runtime/localizer/rival_watch.h"

#include <gtest/gtest.h>

namespace panofix {
namespace {

// A frame with a pose, compared where that is due; whether it was.
bool Frame(RivalWatch* watch, double support, double rival) {
  watch->Advance();
  const bool due = watch->IsDue();
  if (due) {
    watch->Add(support, rival);
  } else {
    watch->Pass();
  }
  return due;
}

TEST(RivalWatch, AStreetOfItsOwnIsTrustedAtOnceAndComparedSeldom) {
  RivalWatch watch;
  int num_compared = 0;
  for (int frame = 0; frame < 110; ++frame) {
    num_compared += Frame(&watch, 0.2, 0.02) ? 1 : 0;
    EXPECT_FALSE(watch.IsAmbiguous());
  }
  const RivalWatchOptions options;
  EXPECT_EQ(num_compared, options.first_frames + 100 / options.period_frames);
}

TEST(RivalWatch, ALookAlikeIsAmbiguousAtOnce) {
  RivalWatch watch;
  Frame(&watch, 0.2, 0.15);
  EXPECT_TRUE(watch.IsAmbiguous());
}

// In single frames the rival hides.
TEST(RivalWatch, ALookAlikeThatHidesNowAndThenStaysAmbiguous) {
  RivalWatch watch;
  for (int frame = 0; frame < 100; ++frame) {
    EXPECT_TRUE(Frame(&watch, 0.2, frame % 3 == 0 ? 0.18 : 0.07));
    EXPECT_TRUE(watch.IsAmbiguous()) << frame;
  }
}

TEST(RivalWatch, WhatWasAmbiguousNeedsManyClearFrames) {
  RivalWatch watch;
  for (int frame = 0; frame < 50; ++frame) Frame(&watch, 0.2, 0.15);
  for (int frame = 0; frame < 5; ++frame) watch.Advance();  // no pose
  int num_clear = 0;
  while (watch.IsAmbiguous() && num_clear < 100) {
    Frame(&watch, 0.2, 0);
    ++num_clear;
  }
  EXPECT_GT(num_clear, 5);
  EXPECT_LT(num_clear, 30);
}

TEST(RivalWatch, ANewRunIsComparedAgain) {
  RivalWatch watch;
  for (int frame = 0; frame < 40; ++frame) Frame(&watch, 0.2, 0);
  Frame(&watch, 0.2, 0);
  watch.Advance();  // lost
  EXPECT_TRUE(Frame(&watch, 0.2, 0));
  EXPECT_TRUE(Frame(&watch, 0.2, 0));
}

TEST(RivalWatch, NothingSeenIsNotAmbiguous) {
  const RivalWatch watch;
  EXPECT_FALSE(watch.IsAmbiguous());
  EXPECT_EQ(watch.Share(), 0);
}

}  // namespace
}  // namespace panofix
