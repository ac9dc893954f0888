#include "runtime/localizer/fix_history.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "tests/support/matchers.h"

namespace panofix {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;
constexpr double kExact_m = 1e-9, kExact_rad = 1e-7;  // the angle of near-equal turns rounds

Rigid3 At(double x_m) { return {Eigen::Quaterniond::Identity(), Eigen::Vector3d(x_m, 0, 0)}; }

TEST(FixHistory, KnowsNothingAtFirst) {
  FixHistory history;
  history.Advance(kSecond_ns);
  EXPECT_TRUE(history.seeds().empty());
  EXPECT_TRUE(history.Predictions(kSecond_ns).empty());
}

TEST(FixHistory, OneFixPredictsStandingStill) {
  FixHistory history;
  history.Add(kSecond_ns, At(5), {3, 1, 4, 1, 5}, false);
  EXPECT_EQ(history.seeds(), (std::vector<std::uint32_t>{3, 1, 4, 1}));
  const auto predictions = history.Predictions(2 * kSecond_ns);
  ASSERT_EQ(predictions.size(), 1U);
  EXPECT_NEAR(predictions[0].translation.x(), 5, kExact_m);
}

TEST(FixHistory, AFixWithoutViewsKeepsThoseBefore) {
  FixHistory history;
  history.Add(kSecond_ns, At(5), {3, 1}, false);
  history.Add(2 * kSecond_ns, At(6), {}, false);
  EXPECT_EQ(history.seeds(), (std::vector<std::uint32_t>{3, 1}));
  EXPECT_NEAR(history.Predictions(3 * kSecond_ns).front().translation.x(), 7, kExact_m);
}

TEST(FixHistory, TwoFixesPredictConstantVelocityInTimeNotInFrames) {
  FixHistory history;
  history.Add(0, At(10), {1}, false);
  history.Add(kSecond_ns, At(13), {1}, false);
  history.Advance(3 * kSecond_ns);  // a dropped frame in between
  const auto predictions = history.Predictions(3 * kSecond_ns);
  ASSERT_EQ(predictions.size(), 2U);
  EXPECT_NEAR(predictions[0].translation.x(), 13 + 2 * 3, kExact_m);
  EXPECT_NEAR(predictions[1].translation.x(), 13, kExact_m);
}

// A quarter of a radian about the vertical in the last second.
TEST(FixHistory, ATurnIsPredictedOnAndOff) {
  const auto turned = [](double angle_rad, double x_m) {
    return Rigid3(Eigen::Quaterniond(Eigen::AngleAxisd(angle_rad, Eigen::Vector3d::UnitZ())),
                  Eigen::Vector3d(x_m, 0, 0));
  };
  FixHistory history;
  history.Add(0, turned(0.5, 10), {1}, false);
  history.Add(kSecond_ns, turned(0.75, 12), {1}, false);
  for (const double ratio : {1.0, 1.5, 2.5}) {
    const auto predictions =
        history.Predictions(static_cast<std::int64_t>((1 + ratio) * kSecond_ns));
    ASSERT_EQ(predictions.size(), 3U) << ratio;
    // Nobody turns on and on: at most half as far again.
    const double turn_rad = 0.25 * std::min(ratio, 1.5);
    const Eigen::Vector3d step(2 * ratio * std::cos(turn_rad), 2 * ratio * std::sin(turn_rad), 0);
    EXPECT_THAT(predictions[0], Rigid3Near(Rigid3(turned(0.75 + turn_rad, 0).rotation,
                                                  Eigen::Vector3d(12, 0, 0) + step),
                                           kExact_rad, kExact_m));
    EXPECT_THAT(predictions[1], Rigid3Near(turned(0.75, 12 + 2 * ratio), kExact_rad, kExact_m));
    EXPECT_THAT(predictions[2], Rigid3Near(turned(0.75, 12), kExact_rad, kExact_m));
  }
}

TEST(FixHistory, ATurnThatIsNoneIsNotPredicted) {
  FixHistory history;
  history.Add(0, At(10), {1}, false);
  Rigid3 next = At(13);
  next.rotation = Eigen::AngleAxisd(0.02, Eigen::Vector3d::UnitZ());
  history.Add(kSecond_ns, next, {1}, false);
  EXPECT_EQ(history.Predictions(2 * kSecond_ns).size(), 2U);
}

TEST(FixHistory, ForgetsPosesFirstAndTheWindowLater) {
  FixHistoryOptions options;
  options.prediction_age_s = 4, options.window_age_s = 20;
  FixHistory history(options);
  history.Add(kSecond_ns, At(1), {7}, false);
  history.Advance(5 * kSecond_ns);
  EXPECT_EQ(history.Predictions(5 * kSecond_ns).size(), 1U);
  history.Advance(5 * kSecond_ns + 1);
  EXPECT_TRUE(history.Predictions(5 * kSecond_ns + 1).empty());
  EXPECT_FALSE(history.seeds().empty());
  history.Advance(22 * kSecond_ns);
  EXPECT_TRUE(history.seeds().empty());
}

TEST(FixHistory, TimesThatStandStillOrRunBackwardsMakeItForget) {
  for (const std::int64_t now_ns :
       {kSecond_ns, kSecond_ns - 1, std::int64_t{0}, std::numeric_limits<std::int64_t>::min()}) {
    FixHistory history;
    history.Add(kSecond_ns, At(1), {7}, false);
    history.Advance(now_ns);
    EXPECT_TRUE(history.seeds().empty()) << now_ns;
    EXPECT_TRUE(history.Predictions(now_ns).empty()) << now_ns;
  }
}

TEST(FixHistory, ADegradedFixOpensTheWindowButPredictsNothing) {
  FixHistory history;
  history.Add(0, At(1), {7}, false);
  history.Add(kSecond_ns, At(2), {8}, true);
  EXPECT_EQ(history.seeds(), std::vector<std::uint32_t>{8});
  EXPECT_TRUE(history.Predictions(2 * kSecond_ns).empty());
}

TEST(FixHistory, ALostFrameKeepsTheRun) {
  FixHistory history;
  history.Add(0, At(1), {7}, false);
  history.Advance(kSecond_ns);  // and nothing is added
  history.Advance(2 * kSecond_ns);
  EXPECT_EQ(history.seeds(), std::vector<std::uint32_t>{7});
  EXPECT_EQ(history.Predictions(2 * kSecond_ns).size(), 1U);
}

}  // namespace
}  // namespace panofix
