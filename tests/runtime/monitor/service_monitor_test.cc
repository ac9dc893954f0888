#include "runtime/monitor/service_monitor.h"

#include <gtest/gtest.h>

#include <cmath>
#include <thread>

#include "common/geometry/attitude.h"
#include "runtime/monitor/live_json.h"

namespace panofix {
namespace {

FrameResult Fix(std::int64_t timestamp_ns) {
  FrameResult result;
  result.timestamp_ns = timestamp_ns;
  result.status = FixStatus::kFix;
  FramePose pose;
  pose.position = {48, 2, 90};
  pose.attitude.heading_deg = 30;
  pose.enu_from_cam = pose.map_from_cam = Eigen::Quaterniond::Identity();
  pose.position_in_map.setZero();
  pose.covariance_in_map.setIdentity();
  result.pose = pose;
  result.latency = {1, 2, 3, 4, 5, 15};
  return result;
}

FrameResult NoFix(std::int64_t timestamp_ns, const std::string& reason) {
  FrameResult result;
  result.timestamp_ns = timestamp_ns;
  result.reason = reason;
  return result;
}

TEST(LatencyHistogram, CountsByBucketAndKeepsTheSum) {
  LatencyHistogram h;
  for (const double ms : {0.0, 2.0, 2.1, 500.0, 9999.0}) h.Add(ms);
  EXPECT_EQ(h.num(), 5);
  EXPECT_DOUBLE_EQ(h.sum_ms(), 10503.1);
  EXPECT_EQ(h.NumUpTo(0), 2);  // an upper end belongs to its bucket
  EXPECT_EQ(h.NumUpTo(1), 3);
  EXPECT_EQ(h.NumUpTo(LatencyHistogram::kUpper_ms.size() - 1), 4);
}

TEST(ServiceMonitor, CountsAnswersByStatusAndReason) {
  ServiceMonitor monitor;
  EXPECT_FALSE(monitor.Snapshot().since_answer_s);
  monitor.AddAnswer(Fix(1), 10, 20);
  EXPECT_TRUE(monitor.Snapshot().since_fix_s);
  monitor.AddAnswer(NoFix(2, "deadline"), 0, 0);
  monitor.AddAnswer(NoFix(3, "deadline"), 0, 0);
  monitor.Count(&MonitorSnapshot::num_refused, 2);
  const MonitorSnapshot s = monitor.Snapshot();
  EXPECT_EQ(s.num_answers, 3);
  EXPECT_EQ(s.num_fixes, 1);
  EXPECT_EQ(s.num_refused, 2);
  EXPECT_EQ(s.answers.at({FixStatus::kNoFix, "deadline"}), 2);
  const auto sum_ms = [&](ServiceStage stage) {
    return s.latency[static_cast<std::size_t>(stage)].sum_ms();
  };
  EXPECT_DOUBLE_EQ(sum_ms(ServiceStage::kWait), 10);
  EXPECT_DOUBLE_EQ(sum_ms(ServiceStage::kRetrieval), 3);
  EXPECT_DOUBLE_EQ(sum_ms(ServiceStage::kTotal), 45);  // wait, decoding and the engine's own 15
}

TEST(ServiceMonitor, TheTrailIsBoundedAndAskedForByNumber) {
  ServiceMonitor monitor;
  EXPECT_TRUE(monitor.TrailAfter(0).empty());
  const auto kept = static_cast<std::int64_t>(ServiceMonitor::kTrailPoints);
  for (std::int64_t i = 1; i <= kept + 10; ++i) monitor.AddAnswer(NoFix(i, "x"), 0, 0);
  const auto all = monitor.TrailAfter(0);
  ASSERT_EQ(all.size(), ServiceMonitor::kTrailPoints);
  EXPECT_EQ(all.front().number, 11);
  const auto last = monitor.TrailAfter(kept + 8);
  ASSERT_EQ(last.size(), 2U);
  EXPECT_EQ(last[0].timestamp_ns, kept + 9);
  EXPECT_TRUE(monitor.TrailAfter(kept + 10).empty());
  EXPECT_TRUE(monitor.TrailAfter(std::numeric_limits<std::int64_t>::max() - 5).empty());
  EXPECT_EQ(monitor.TrailAfter(-7).size(), all.size());
}

// A long axis of 3 m towards 30 degrees east of north, in a grid turned by 0.2 rad.
TEST(ServiceMonitor, TheEllipseStandsInEastAndNorth) {
  FrameResult result = Fix(1);
  const double along_rad = 30 * kRadPerDeg;
  const Eigen::Vector3d u(std::sin(along_rad), std::cos(along_rad), 0), v(u.y(), -u.x(), 0);
  const Eigen::Matrix3d in_enu = 9 * u * u.transpose() + 0.25 * v * v.transpose();
  const Eigen::AngleAxisd map_from_enu(0.2, Eigen::Vector3d::UnitZ());
  result.pose->map_from_cam = Eigen::Quaterniond(map_from_enu);
  result.pose->covariance_in_map.topLeftCorner<3, 3>() =
      map_from_enu * in_enu * map_from_enu.toRotationMatrix().transpose();
  ServiceMonitor monitor;
  monitor.AddAnswer(result, 0, 0);
  const TrailPoint point = monitor.TrailAfter(0).at(0);
  constexpr double kTolerance = 1e-9;
  EXPECT_NEAR(point.sigma_long_m, 3, kTolerance);
  EXPECT_NEAR(point.sigma_short_m, 0.5, kTolerance);
  // An axis has no sign.
  EXPECT_NEAR(std::fmod(point.sigma_turn_deg + 360, 180), 30, 1e-6);
}

TEST(ServiceMonitor, WatchersMayReadWhileItCounts) {
  ServiceMonitor monitor;
  constexpr int kAnswers = 3000;
  std::thread writer([&] {
    for (int i = 1; i <= kAnswers; ++i) monitor.AddAnswer(Fix(i), 0, 0);
  });
  std::int64_t seen = 0;
  while (seen < kAnswers) {
    for (const TrailPoint& point : monitor.TrailAfter(seen)) {
      ASSERT_GT(point.number, seen);
      seen = point.number;
    }
  }
  writer.join();
  EXPECT_EQ(monitor.Snapshot().num_fixes, kAnswers);
}

TEST(LiveJson, SurvivesTextThatIsNoUtf8) {
  ServiceMonitor monitor;
  MapFacts facts;
  facts.bundle.name = "caf\xe9 \"</script>";
  monitor.SetMap(facts);
  monitor.AddAnswer(NoFix(1, "\xff\xfe"), 0, 0);
  const std::string json = LiveJson(monitor.Snapshot(), monitor.TrailAfter(0));
  EXPECT_NE(json.find("\\\"</script>"), std::string::npos);
  EXPECT_EQ(json.find('\xff'), std::string::npos);
  EXPECT_NE(RouteJson(facts).find("\"panoramas\":[]"), std::string::npos);
}

}  // namespace
}  // namespace panofix
