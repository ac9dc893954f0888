#include "common/base/progress.h"

#include <gtest/gtest.h>

#include <thread>
#include <vector>

namespace panofix {
namespace {

TEST(ProgressLine, SaysRateAndTimeLeft) {
  EXPECT_EQ(Progress::Line("extract", 12, 40, "panoramas", 4.0),
            "extract 12/40 panoramas, 3.0/s, 9 s left");
}

TEST(ProgressLine, NothingDoneYetPromisesNothing) {
  EXPECT_EQ(Progress::Line("extract", 0, 40, "panoramas", 4.0), "extract 0/40 panoramas");
}

TEST(ProgressLine, TheEndSaysTheWholeTime) {
  EXPECT_EQ(Progress::Line("extract", 40, 40, "panoramas", 80.0),
            "extract 40/40 panoramas, 0.5/s, 1 min 20 s");
}

TEST(ProgressLine, LongWorkIsToldInMinutesAndHours) {
  EXPECT_EQ(Progress::Line("x", 1, 3600, "y", 1.0), "x 1/3600 y, 1.0/s, 59 min 59 s left");
  EXPECT_EQ(Progress::Line("x", 1, 3661, "y", 1.0), "x 1/3661 y, 1.0/s, 1 h 01 min left");
}

TEST(ProgressLine, DegenerateTotalsAndClocks) {
  EXPECT_EQ(Progress::Line("x", 0, 0, "y", 0.0), "x 0/0 y, 0 s");
  EXPECT_EQ(Progress::Line("x", 1, 2, "y", 0.0), "x 1/2 y, 0.0/s");
}

TEST(Progress, OffATerminalPrintsOneLineAtTheEnd) {
  testing::internal::CaptureStderr();
  {
    Progress progress("count", 4000, "things");
    std::vector<std::thread> threads;
    for (int t = 0; t < 4; ++t) {
      threads.emplace_back([&] {
        for (int i = 0; i < 1000; ++i) progress.Add();
      });
    }
    for (auto& thread : threads) thread.join();
    progress.Finish();
    progress.Finish();  // and the destructor: still one line
  }
  const std::string text = testing::internal::GetCapturedStderr();
  EXPECT_EQ(text.substr(0, 23), "count 4000/4000 things,");
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 1);
}

}  // namespace
}  // namespace panofix
