// The power goes, the process is killed, the disk is full: at every single call that changes a file
// while a map is installed and put in force. The runtime must always start with a whole map, the
// old one or the new one, and the same install must succeed afterwards.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include "runtime/store/upkeep.h"
#include "tests/runtime/store/store_kit.h"
#include "tests/support/crash_disk.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kFewestCalls = 50;  // an install of four parts, two of them new

class CrashTest : public StoreKit {
 protected:
  CrashTest() {
    Run(1);
    Bundle(2);
  }

  // Build 2 into the store and in force; in a child with the disk armed. Its exit code.
  int InstallInChild(const CrashPlan& plan, bool as_package) {
    const fs::path bundle = Bundle(2), package = folder_ / "two.pfb";
    if (as_package) WriteText(package, PackageBytes(EntriesOf(bundle)));
    const pid_t child = ::fork();
    if (child == 0) {
      ArmCrash(plan);
      const auto source = as_package ? MakePackageSource(package) : MakeFolderSource(bundle);
      const auto report = Install(layout_, *source, {});
      const bool is_done = report.ok() && ActivateHere(report->id).ok();
      if (plan.at_call == 0) WriteCount();
      ::_exit(is_done ? 0 : 1);
    }
    int how = 0;
    ::waitpid(child, &how, 0);
    EXPECT_TRUE(WIFEXITED(how));
    return WEXITSTATUS(how);
  }
  void WriteCount() {
    const std::int64_t count = NumDiskCalls();
    WriteText(folder_ / "count", std::to_string(count));
  }

  void ExpectWholeAndGoesOn(const std::string& where, int exit_code) {
    SCOPED_TRACE(where);
    // The next start of the runtime.
    const Status settled = SettleActivation(layout_, OpeningProbe(layout_));
    EXPECT_TRUE(settled.ok()) << settled.message();
    const std::int64_t build = OpenedBuild(layout_);
    EXPECT_TRUE(build == 1 || build == 2) << build;
    if (exit_code == 0) {
      EXPECT_EQ(build, 2);
    }
    // The next try.
    const auto again = InstallFolder(Bundle(2));
    ASSERT_TRUE(again.ok()) << again.status().message();
    const Status active = ActivateHere(again->id);
    ASSERT_TRUE(active.ok()) << active.message();
    EXPECT_EQ(OpenedBuild(layout_), 2);
    const auto report = CheckStore(layout_, false);
    ASSERT_TRUE(report.ok()) << report.status().message();
    EXPECT_TRUE(report->faults.empty()) << report->faults.front();
  }

  // Every call of one install, one after the other; how many points were played.
  std::int64_t PlayAll(CrashPlan::Kind kind, bool as_package, std::uint64_t seed = 1) {
    const fs::path before = folder_ / "before";
    fs::copy(layout_.root, before, fs::copy_options::recursive);
    EXPECT_EQ(InstallInChild({kind, 0, 1}, as_package), 0);
    const std::int64_t num_calls = std::stoll(ReadText(folder_ / "count"));
    for (std::int64_t call = 1; call <= num_calls; ++call) {
      fs::remove_all(layout_.root);
      fs::copy(before, layout_.root, fs::copy_options::recursive);
      const CrashPlan plan{kind, call, seed};
      const int exit_code = InstallInChild(plan, as_package);
      const bool must_end = kind == CrashPlan::Kind::kKill || kind == CrashPlan::Kind::kPowerLoss;
      if (must_end) {
        EXPECT_EQ(exit_code, kCrashExitCode) << "call " << call;
      }
      ExpectWholeAndGoesOn("call " + std::to_string(call), exit_code);
      if (HasFatalFailure()) break;
    }
    return num_calls;
  }
};

TEST_F(CrashTest, KilledAtEveryCall) {
  EXPECT_GT(PlayAll(CrashPlan::Kind::kKill, false), kFewestCalls);
}

TEST_F(CrashTest, KilledAtEveryCallOfAPackage) {
  EXPECT_GT(PlayAll(CrashPlan::Kind::kKill, true), kFewestCalls);
}

TEST_F(CrashTest, PowerLostAtEveryCallAndNoUnflushedNameHolds) {
  EXPECT_GT(PlayAll(CrashPlan::Kind::kPowerLoss, false, 0), kFewestCalls);
}

TEST_F(CrashTest, PowerLostAtEveryCallAndTheFirstUnflushedNamesHold) {
  EXPECT_GT(PlayAll(CrashPlan::Kind::kPowerLoss, false, 7919), kFewestCalls);
}

TEST_F(CrashTest, DiskFullFromEveryCallOn) {
  EXPECT_GT(PlayAll(CrashPlan::Kind::kDiskFull, false), kFewestCalls);
}

TEST_F(CrashTest, EveryCallFailsOnce) {
  EXPECT_GT(PlayAll(CrashPlan::Kind::kIoError, false), kFewestCalls);
}

}  // namespace
}  // namespace panofix
