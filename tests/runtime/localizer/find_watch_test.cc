#include "runtime/localizer/find_watch.h"

#include <gtest/gtest.h>

#include <limits>

#include "common/geometry/attitude.h"

namespace panofix {
namespace {

constexpr std::int64_t kFrame_ns = 100'000'000;
constexpr std::int64_t kLater_ns = std::numeric_limits<std::int64_t>::max();
constexpr double kStep_m = 0.8;  // between frames

Eigen::Quaterniond Turned(double yaw_deg) {
  return Eigen::Quaterniond(EnuFromBody({yaw_deg, 0, 0}) * BodyFromCam());
}

// Where a vehicle is at a frame, `aside_m` to the side of its way and turned `turn_deg` from it.
Rigid3 OnTheWay(int frame, double aside_m = 0, double turn_deg = 0) {
  return {Turned(30 + frame + turn_deg), Eigen::Vector3d(aside_m, kStep_m * frame, 1.6)};
}

// Whether a frame's find is confirmed.
bool Find(FindWatch* watch, int frame, const Rigid3& pose, bool is_firm = true) {
  watch->Advance(frame * kFrame_ns);
  watch->Add(frame * kFrame_ns, pose, is_firm);
  return watch->IsConfirmed();
}

TEST(FindWatch, ConfirmsFindsAlongOneMotion) {
  FindWatch watch;
  EXPECT_FALSE(watch.IsConfirmed());
  EXPECT_FALSE(Find(&watch, 0, OnTheWay(0, 0.1)));
  EXPECT_FALSE(Find(&watch, 1, OnTheWay(1, -0.1)));
  EXPECT_TRUE(Find(&watch, 2, OnTheWay(2)));
}

TEST(FindWatch, LeavesOutAFindThatIsOff) {
  for (const Rigid3& off : {OnTheWay(1, 1.5), OnTheWay(1, 0, 5)}) {
    FindWatch watch;
    EXPECT_FALSE(Find(&watch, 0, OnTheWay(0)));
    EXPECT_FALSE(Find(&watch, 1, off));
    EXPECT_FALSE(Find(&watch, 2, OnTheWay(2)));
    EXPECT_TRUE(Find(&watch, 3, OnTheWay(3)));
  }
}

TEST(FindWatch, IsNotConfirmedByTheOthersWhereItIsOff) {
  FindWatch watch;
  for (int frame = 0; frame < 3; ++frame) static_cast<void>(Find(&watch, frame, OnTheWay(frame)));
  EXPECT_FALSE(Find(&watch, 3, OnTheWay(3, 2)));
  EXPECT_TRUE(Find(&watch, 4, OnTheWay(4)));
}

// Poses here and there do not lie along a motion, unless by chance; that takes half of them.
TEST(FindWatch, AMinorityConfirmsNothing) {
  FindWatch watch;
  const double asides_m[] = {2.1, 0, -1.3, 4.4, 0, 1.2, -3.7, 0};
  for (int frame = 0; frame < 8; ++frame)
    EXPECT_FALSE(Find(&watch, frame, OnTheWay(frame, asides_m[frame]))) << frame;
}

// In its window, then in the whole map: two finds of one frame are one.
TEST(FindWatch, AFrameDoesNotConfirmItself) {
  FindWatch watch;
  EXPECT_FALSE(Find(&watch, 0, OnTheWay(0, 3)));
  EXPECT_FALSE(Find(&watch, 1, OnTheWay(1)));
  watch.Add(kFrame_ns, OnTheWay(1, 0.05), true);
  EXPECT_FALSE(watch.IsConfirmed());
  EXPECT_EQ(watch.Before(kFrame_ns, 9).size(), 1U);
  EXPECT_FALSE(Find(&watch, 2, OnTheWay(2)));
  watch.Add(2 * kFrame_ns, OnTheWay(2, 0.05), true);
  EXPECT_FALSE(watch.IsConfirmed());
  EXPECT_TRUE(Find(&watch, 3, OnTheWay(3)));
}

// A camera that stands still repeats its error.
TEST(FindWatch, ACameraAtRestConfirmsNothing) {
  FindWatch watch;
  for (int frame = 0; frame < 15; ++frame) EXPECT_FALSE(Find(&watch, frame, OnTheWay(0)));
}

TEST(FindWatch, NobodyIsSoFastOrTurnsSo) {
  FindWatch fast, turning;
  for (int frame = 0; frame < 5; ++frame) {
    EXPECT_FALSE(Find(&fast, frame, OnTheWay(10 * frame)));
    EXPECT_FALSE(Find(&turning, frame, OnTheWay(frame, 0, 15 * frame)));
  }
}

TEST(FindWatch, OnlyFirmFindsConfirmAndAreConfirmed) {
  FindWatch watch;
  EXPECT_FALSE(Find(&watch, 0, OnTheWay(0)));
  EXPECT_FALSE(Find(&watch, 1, OnTheWay(1), false));
  EXPECT_FALSE(Find(&watch, 2, OnTheWay(2)));
  EXPECT_FALSE(Find(&watch, 3, OnTheWay(3), false));
  EXPECT_TRUE(Find(&watch, 4, OnTheWay(4)));
}

TEST(FindWatch, ForgetsWhatIsOldOrLater) {
  FindWatch watch;
  static_cast<void>(Find(&watch, 0, OnTheWay(0)));
  static_cast<void>(Find(&watch, 1, OnTheWay(1)));
  EXPECT_FALSE(Find(&watch, 40, OnTheWay(40)));  // beyond max_age_s
  EXPECT_EQ(watch.Before(kLater_ns, 9).size(), 1U);
  EXPECT_FALSE(Find(&watch, 39, OnTheWay(39)));  // time runs backwards
  EXPECT_EQ(watch.Before(kLater_ns, 9).size(), 1U);
  watch.Advance(std::numeric_limits<std::int64_t>::min());
  EXPECT_TRUE(watch.Before(kLater_ns, 9).empty());
  watch.Add(std::numeric_limits<std::int64_t>::min(), OnTheWay(0), true);
  watch.Advance(std::numeric_limits<std::int64_t>::max());
  EXPECT_TRUE(watch.Before(kLater_ns, 9).empty());
}

TEST(FindWatch, TellsTheFindsBeforeLatestFirst) {
  FindWatch watch;
  for (int frame = 0; frame < 3; ++frame)
    static_cast<void>(Find(&watch, frame, OnTheWay(frame), frame != 1));
  const std::vector<Rigid3> last = watch.Before(kLater_ns, 2);
  ASSERT_EQ(last.size(), 2U);
  EXPECT_EQ(last[0].translation, OnTheWay(2).translation);
  EXPECT_EQ(last[1].translation, OnTheWay(1).translation);
}

}  // namespace
}  // namespace panofix
