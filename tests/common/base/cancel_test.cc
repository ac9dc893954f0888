#include "common/base/cancel.h"

#include <gtest/gtest.h>
#include <signal.h>

namespace panofix {
namespace {

TEST(Cancel, IsAskedForAndCleared) {
  ClearCancel();
  EXPECT_FALSE(CancelRequested());
  RequestCancel();
  EXPECT_TRUE(CancelRequested());
  ClearCancel();
  EXPECT_FALSE(CancelRequested());
}

TEST(Cancel, BothSignalsAskForIt) {
  for (const int signal : {SIGINT, SIGTERM}) {
    // In a child of its own: the handlers and the flag stay out of the other tests.
    EXPECT_EXIT(
        {
          InstallCancelHandlers();
          ::raise(signal);
          ::_exit(CancelRequested() ? 0 : 1);
        },
        testing::ExitedWithCode(0), "")
        << signal;
  }
}

TEST(Cancel, ASecondSignalEndsTheProgramAtOnce) {
  EXPECT_EXIT(
      {
        InstallCancelHandlers();
        ::raise(SIGINT);
        ::raise(SIGTERM);
        ::_exit(1);
      },
      testing::ExitedWithCode(130), "");
}

}  // namespace
}  // namespace panofix
