#include "runtime/localizer/calibration_watch.h"

#include <gtest/gtest.h>

#include <cmath>

#include "common/base/rng.h"

namespace panofix {
namespace {

TEST(CalibrationWatch, NothingSeenIsNothingKnown) {
  const CalibrationWatch watch;
  EXPECT_FALSE(watch.IsOff());
  EXPECT_GT(watch.Estimate().sigma, 1e6);
}

TEST(CalibrationWatch, FivePerCentIsSeenWithinThreeFrames) {
  for (const double error : {-0.05, 0.05}) {
    CalibrationWatch watch;
    for (int frame = 0; frame < 3; ++frame) watch.Add({0.8 * error, 0.006});
    EXPECT_TRUE(watch.IsOff());
  }
}

TEST(CalibrationWatch, NoiseDoesNotAddUp) {
  Rng rng(1, "tests/calibration");
  CalibrationWatch watch;
  for (int frame = 0; frame < 1000; ++frame) {
    watch.Add({rng.Uniform(-0.015, 0.015), 0.006});
    ASSERT_FALSE(watch.IsOff()) << frame;
  }
}

// Neighbouring frames share their errors: a few with the same large one are one finding.
TEST(CalibrationWatch, AFewFramesOfOnePlaceDoNotAccuse) {
  CalibrationWatch watch;
  for (const FocalCheck& check : {FocalCheck{0.047, 0.015}, {0.071, 0.022}, {0.026, 0.015}}) {
    watch.Add(check);
    EXPECT_FALSE(watch.IsOff());
  }
}

TEST(CalibrationWatch, ACameraThatIsChangedIsNoticed) {
  CalibrationWatch watch;
  for (int frame = 0; frame < 5000; ++frame) watch.Add({0.0, 0.006});
  EXPECT_FALSE(watch.IsOff());
  int frames = 0;
  for (; frames < 1000 && !watch.IsOff(); ++frames) watch.Add({0.04, 0.006});
  EXPECT_LT(frames, 200);
}

TEST(CalibrationWatch, FramesThatSayNothingChangeNothing) {
  CalibrationWatch watch;
  for (int frame = 0; frame < 100; ++frame) watch.Add({0.5, 1e9});
  watch.Add({std::nan(""), 0.01});
  watch.Add({0.1, std::nan("")});
  EXPECT_FALSE(watch.IsOff());
  EXPECT_LT(std::abs(watch.Estimate().sigma), 1e9);
}

}  // namespace
}  // namespace panofix
