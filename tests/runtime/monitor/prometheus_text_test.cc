#include "runtime/monitor/prometheus_text.h"

#include <gtest/gtest.h>

#include <map>
#include <regex>
#include <set>
#include <sstream>

namespace panofix {
namespace {

// Values by name and labels; fails where a line breaks the format.
std::map<std::string, double> Parse(const std::string& text) {
  static const std::regex sample(
      R"re(^([a-z_]+)(\{[a-z_]+="(\\.|[^"\\])*"(,[a-z_]+="(\\.|[^"\\])*")*\})? ([-+0-9.e]+)$)re");
  static const std::regex comment(R"re(^# (HELP|TYPE) ([a-z_]+) .+$)re");
  std::map<std::string, double> values;
  std::set<std::string> typed;
  std::istringstream lines(text);
  std::smatch match;
  for (std::string line; std::getline(lines, line);) {
    if (std::regex_match(line, match, comment)) {
      if (match[1] == "TYPE") {
        EXPECT_TRUE(typed.insert(match[2]).second) << "twice: " << line;
      }
      continue;
    }
    if (!std::regex_match(line, match, sample)) {
      ADD_FAILURE() << "no sample: " << line;
      continue;
    }
    const std::string name = match[1];
    const bool is_known = typed.contains(name) ||
                          typed.contains(name.substr(0, name.rfind('_')));  // _bucket, _sum, _count
    EXPECT_TRUE(is_known) << "before its TYPE: " << line;
    EXPECT_TRUE(values.emplace(name + match[2].str(), std::stod(match[6])).second) << line;
  }
  return values;
}

FrameResult Result(FixStatus status, const std::string& reason, double total_ms) {
  FrameResult result;
  result.status = status;
  result.reason = reason;
  result.latency.total_ms = total_ms;
  return result;
}

TEST(PrometheusText, SaysWhatTheMonitorCounted) {
  ServiceMonitor monitor;
  FeedCounts feed;
  feed.frames = 100, feed.replaced = 40, feed.denied = 2;
  monitor.SetFeed(feed);
  MapFacts facts;
  facts.bundle.name = "town";
  facts.bundle.id = "abc";
  facts.bundle.build = 7;
  facts.created_s = 1000;
  facts.num_tiles = 5;
  monitor.SetMap(facts);
  monitor.AddAnswer(Result(FixStatus::kFix, "", 30), 1, 2);
  monitor.AddAnswer(Result(FixStatus::kNoFix, "deadline", 120), 1, 2);
  monitor.AddAnswer(Result(FixStatus::kNoFix, "deadline", 9000), 1, 2);
  auto values = Parse(ToPrometheusText(monitor.Snapshot(), {1 << 20, 2.5}, 1060));
  EXPECT_EQ(values["panofix_frames_received_total"], 100);
  EXPECT_EQ(values["panofix_frames_dropped_total{cause=\"replaced\"}"], 40);
  EXPECT_EQ(values["panofix_peers_denied_total{socket=\"frames\"}"], 2);
  EXPECT_EQ(values["panofix_answers_total{status=\"fix\",reason=\"\"}"], 1);
  EXPECT_EQ(values["panofix_answers_total{status=\"no_fix\",reason=\"deadline\"}"], 2);
  EXPECT_EQ(values["panofix_map_info{name=\"town\",id=\"abc\",signed=\"false\"}"], 1);
  EXPECT_EQ(values["panofix_map_build"], 7);
  EXPECT_EQ(values["panofix_map_age_seconds"], 60);
  EXPECT_EQ(values["panofix_map_tiles"], 5);
  EXPECT_EQ(values["process_resident_memory_bytes"], 1 << 20);
  EXPECT_EQ(values["process_cpu_seconds_total"], 2.5);
  const std::string total = "panofix_latency_seconds_bucket{stage=\"total\",le=\"";
  EXPECT_EQ(values[total + "0.035\"}"], 1);
  EXPECT_EQ(values[total + "0.15\"}"], 2);
  EXPECT_EQ(values[total + "2.5\"}"], 2);
  EXPECT_EQ(values[total + "+Inf\"}"], 3);
  EXPECT_NEAR(values["panofix_latency_seconds_sum{stage=\"total\"}"], 9.159, 1e-9);
  EXPECT_EQ(values["panofix_latency_seconds_count{stage=\"decode\"}"], 3);
}

TEST(PrometheusText, BeforeTheFirstFrameNothingIsMadeUp) {
  const auto values = Parse(ToPrometheusText(ServiceMonitor().Snapshot(), ReadProcessUse(), 1));
  EXPECT_EQ(values.count("panofix_last_fix_age_seconds"), 0U);
  EXPECT_EQ(values.count("panofix_map_age_seconds"), 0U);
  EXPECT_GT(values.at("process_resident_memory_bytes"), 1e5);
  EXPECT_GT(values.at("process_cpu_seconds_total"), 0);
}

TEST(PrometheusText, NamesOfMapsCannotBreakALine) {
  ServiceMonitor monitor;
  MapFacts facts;
  facts.bundle.name = "a\"b\\c\nd";
  monitor.SetMap(facts);
  const auto values = Parse(ToPrometheusText(monitor.Snapshot(), {}, 1));
  EXPECT_EQ(values.count("panofix_map_info{name=\"a\\\"b\\\\c d\",id=\"\",signed=\"false\"}"), 1U);
}

}  // namespace
}  // namespace panofix
