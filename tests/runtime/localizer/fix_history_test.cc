#include "runtime/localizer/fix_history.h"

#include <gtest/gtest.h>

#include <limits>

namespace panofix {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;
constexpr double kExact_m = 1e-9;

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

TEST(FixHistory, ALostFrameBreaksTheRun) {
  FixHistory history;
  history.Add(0, At(1), {7}, false);
  history.Lose();
  EXPECT_TRUE(history.seeds().empty());
  EXPECT_TRUE(history.Predictions(kSecond_ns).empty());
}

}  // namespace
}  // namespace panofix
