#include "builder/validate/score.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "common/base/rng.h"

namespace panofix {
namespace {

constexpr double kTolerance_m = 1e-5;  // of the plane that the oracle moves points in
constexpr double kTolerance = 1e-9;

const Geodetic kHome{48.85, 2.335, 35};

// `home` moved along the ellipsoid's axes.
Geodetic Moved(double east_m, double north_m, double up_m) {
  constexpr double kA_m = 6378137.0, kE2 = 6.69437999014e-3;
  const double s = std::sin(kHome.lat_deg * kRadPerDeg), w = std::sqrt(1 - kE2 * s * s);
  const double meridian_m = kA_m * (1 - kE2) / (w * w * w), prime_m = kA_m / w;
  return {kHome.lat_deg + north_m / meridian_m / kRadPerDeg,
          kHome.lon_deg + east_m / (prime_m * std::cos(kHome.lat_deg * kRadPerDeg)) / kRadPerDeg,
          kHome.height_m + up_m};
}

// A drive whose truth stands still at home, and rows that are off by what a test says.
struct Trial {
  Drive drive;
  std::vector<PoseRow> rows;

  void AddFrame(bool with_truth = true) {
    const auto time = static_cast<std::int64_t>(drive.frames.size()) * 100;
    drive.frames.push_back({time, "x.jpg"});
    if (with_truth) drive.truth.push_back({time, kHome, Attitude{30, 1, -1}});
  }
  PoseRow& AddFix(double east_m, double north_m = 0, double up_m = 0, double heading_deg = 0) {
    AddFrame();
    PoseColumns pose;
    pose.position = Moved(east_m, north_m, up_m);
    pose.attitude = {30 + heading_deg, 1, -1};
    pose.sigma_east_m = 0.1, pose.sigma_north_m = 0.2, pose.sigma_up_m = 0.4,
    pose.sigma_heading_deg = 0.5;
    rows.push_back({drive.frames.back().timestamp_ns, FixStatus::kFix, "", pose, 30, 2, "p", 20});
    return rows.back();
  }
  void AddNoFix() {
    AddFrame();
    rows.push_back({drive.frames.back().timestamp_ns, FixStatus::kNoFix, "lost", {}, 0, 0, "", 20});
  }
  [[nodiscard]] ScoreTable Table(const RunLog& log = {}) const {
    return Score(drive, rows, log, 0);
  }
};

TEST(Score, ErrorsAreThoseOfTheFixes) {
  Trial run;
  run.AddFix(0.3, 0.4, 0);  // 0.5 m
  run.AddFix(0, 0, -0.2);
  run.AddFix(0.1, 0, 0, -3);
  const ScoreTable table = run.Table();
  ASSERT_EQ(table.frames.size(), 3U);
  EXPECT_NEAR(table.frames[0].position_error_m, 0.5, kTolerance_m);
  EXPECT_NEAR(table.frames[1].position_error_m, 0.2, kTolerance_m);
  // A turn about the vertical, seen by a camera that is hardly tilted, keeps its angle.
  EXPECT_NEAR(table.frames[2].attitude_error_deg, 3, 1e-6);
  EXPECT_NEAR(table.median_position_error_m, 0.2, kTolerance_m);
  EXPECT_NEAR(table.p95_position_error_m, 0.5, kTolerance_m);
  EXPECT_NEAR(table.p95_attitude_error_deg, 3, 1e-6);
}

TEST(Score, BandsNeedPositionAndAttitude) {
  Trial run;
  run.AddFix(0.2);
  run.AddFix(0.2, 0, 0, 3);  // turned too far for the first band
  run.AddFix(0.6);
  run.AddFix(0.6, 0, 0, 20);  // for all
  run.AddFix(1.5);
  run.AddFix(4.9, 0, 0, 7);
  run.AddFix(6);
  const ScoreTable table = run.Table();
  EXPECT_EQ(table.num_within, (std::array<int, 5>{1, 2, 3, 4, 5}));
  EXPECT_EQ(table.num_fixes, 7);
  EXPECT_NEAR(table.Share(table.num_within[0]), 1.0 / 7, kTolerance);
}

TEST(Score, OnlyAFixCanBeFalse) {
  Trial run;
  run.AddFix(4.99);
  run.AddFix(5.01);
  run.AddFix(0, 0, 80);  // upwards too
  run.AddFix(300).status = FixStatus::kDegraded;
  const ScoreTable table = run.Table();
  EXPECT_EQ(table.num_false_fixes, 2);
  EXPECT_EQ(table.num_fixes, 3);
  EXPECT_EQ(table.num_degraded, 1);
  EXPECT_NEAR(table.p95_position_error_m, 80, 0.01);  // the degraded one is no fix
}

TEST(Score, GapsAreFramesWithoutAFix) {
  Trial run;
  run.AddNoFix();
  run.AddFix(0);
  run.AddNoFix();
  run.AddFix(0).status = FixStatus::kDegraded;
  run.AddFrame();  // no row at all
  run.AddFix(0);
  run.AddNoFix();
  run.AddNoFix();
  const ScoreTable table = run.Table();
  EXPECT_EQ(table.longest_gap_frames, 3);
  EXPECT_EQ(table.num_frames, 8);
  EXPECT_EQ(table.num_with_truth, 8);
  EXPECT_NEAR(table.Share(table.num_fixes), 2.0 / 8, kTolerance);
}

TEST(Score, GapsAtTheEndAndThroughout) {
  Trial run;
  run.AddFix(0);
  for (int i = 0; i < 4; ++i) run.AddNoFix();
  EXPECT_EQ(run.Table().longest_gap_frames, 4);
  Trial none;
  for (int i = 0; i < 6; ++i) none.AddNoFix();
  EXPECT_EQ(none.Table().longest_gap_frames, 6);
}

TEST(Score, NeesIsTheNormalisedError) {
  Trial run;
  run.AddFix(0.2, -0.2, 0.4, 0.5);  // 2, -1, 1 and 1 sigma
  const ScoreTable table = run.Table();
  ASSERT_TRUE(table.frames[0].nees && table.nees_median);
  EXPECT_NEAR(*table.frames[0].nees, 4 + 1 + 1 + 1, 1e-3);
  EXPECT_NEAR(*table.nees_median, 7, 1e-3);
}

// Errors drawn from the stated sigmas: the median is that of chi-square with 4 degrees of freedom.
TEST(Score, NeesOfHonestSigmasHasItsExpectation) {
  Rng rng(1, "tests/nees");
  Trial run;
  for (int i = 0; i < 4000; ++i) {
    const double east = 0.1 * rng.Normal(), north = 0.2 * rng.Normal(), up = 0.4 * rng.Normal();
    run.AddFix(east, north, up, 0.5 * rng.Normal());
  }
  // The median's standard deviation is 1 / (2 f(m) sqrt(n)) = 0.05; four of them.
  EXPECT_NEAR(run.Table().nees_median.value(), 3.357, 0.2);
}

TEST(Score, HeadingWrapsAround) {
  Trial run;
  run.AddFix(0);
  run.drive.truth[0].attitude = Attitude{359.9, 1, -1};
  run.rows[0].pose->attitude.heading_deg = 0.1;
  const ScoreTable table = run.Table();
  EXPECT_NEAR(*table.frames[0].nees, 0.16, 1e-6);
  EXPECT_NEAR(table.frames[0].attitude_error_deg, 0.2, 1e-6);
}

TEST(Score, BlankAttitudeTruthScoresPositions) {
  Trial run;
  run.AddFix(0.1, 0, 0, 90);
  run.drive.truth[0].attitude.reset();
  const ScoreTable table = run.Table();
  EXPECT_EQ(table.num_within[0], 1);
  EXPECT_EQ(table.frames[0].attitude_error_deg, 0.0);
  EXPECT_FALSE(table.frames[0].nees);
  EXPECT_FALSE(table.nees_median);
}

TEST(Score, AZeroSigmaGivesNoNees) {
  Trial run;
  run.AddFix(0.1).pose->sigma_east_m = 0;
  EXPECT_FALSE(run.Table().nees_median);
}

TEST(Score, FramesWithoutTruthCountInTheSharesOnly) {
  Trial run;
  run.AddFix(0.1);
  run.AddFix(100);
  run.drive.truth.pop_back();
  const ScoreTable table = run.Table();
  EXPECT_EQ(table.num_frames, 2);
  EXPECT_EQ(table.num_with_truth, 1);
  EXPECT_EQ(table.num_fixes, 2);
  EXPECT_EQ(table.num_false_fixes, 0);
  EXPECT_NEAR(table.p95_position_error_m, 0.1, kTolerance_m);
}

// The median against sorting, for every number of fixes up to 300.
TEST(Score, MedianAndPercentileOfAnyNumberOfFixes) {
  Trial run;
  std::vector<double> errors_m;
  Rng rng(1, "tests/median");
  for (std::size_t n = 1; n <= 300; ++n) {
    const double error_m = rng.Uniform(0, 5);
    run.AddFix(error_m);
    errors_m.insert(std::upper_bound(errors_m.begin(), errors_m.end(), error_m), error_m);
    const ScoreTable table = run.Table();
    ASSERT_NEAR(table.median_position_error_m, 0.5 * (errors_m[(n - 1) / 2] + errors_m[n / 2]),
                kTolerance_m)
        << n;
    // Nearest rank: the smallest value that 95 % do not exceed.
    ASSERT_NEAR(table.p95_position_error_m, errors_m[(95 * n + 99) / 100 - 1], kTolerance_m) << n;
  }
}

TEST(Score, LatencyAndComparisonsComeFromTheLog) {
  Trial run;
  RunLog log;
  log.resident_memory_bytes = 250'000'000;
  for (int i = 1; i <= 100; ++i) {
    run.AddFix(0);
    RunLogEntry entry;
    entry.latency.total_ms = i;
    entry.latency.pose_ms = 0.5 * i;
    entry.num_compared = i == 1 ? 800 : 80;
    entry.num_database = 800;
    log.frames.push_back(entry);
  }
  const ScoreTable table = run.Table(log);
  EXPECT_NEAR(table.comparisons_avoided, 1 - (800 + 99 * 80.0) / 80000, kTolerance);
  EXPECT_NEAR(table.resident_memory_mb, 250, kTolerance);
  const auto& [name, total] = table.latency_ms.back();
  EXPECT_EQ(name, "total");
  EXPECT_EQ(total.p50, 50.0);
  EXPECT_EQ(total.p95, 95.0);
  EXPECT_EQ(total.p99, 99.0);
}

// A table of zeros would read as a verdict.
TEST(Score, WhatDoesNotBelongTogetherIsRefused) {
  Drive drive;
  drive.frames = {{1, "a.jpg"}, {2, "b.jpg"}};
  drive.truth.resize(1);
  drive.truth[0].timestamp_ns = 3;
  EXPECT_THROW((void)Score(drive, {}, {}, 0), Error);
  drive.truth[0].timestamp_ns = 2;
  EXPECT_NO_THROW((void)Score(drive, {}, {}, 0));
  PoseRow row;
  row.timestamp_ns = 7;
  EXPECT_THROW((void)Score(drive, {row}, {}, 0), Error);
  row.timestamp_ns = 1;
  EXPECT_NO_THROW((void)Score(drive, {row}, {}, 0));
  EXPECT_THROW((void)Score(drive, {row, row}, {}, 0), Error);
}

TEST(Score, NothingFixedLeavesErrorsUnsaid) {
  Drive drive;
  drive.frames = {{1, "a.jpg"}};
  drive.truth.resize(1);
  drive.truth[0].timestamp_ns = 1;
  const ScoreTable table = Score(drive, {}, {}, 0);
  EXPECT_NE(table.ToText().find("position error of fixes            -"), std::string::npos);
  EXPECT_TRUE(nlohmann::json::parse(table.ToJson())["median_position_error_m"].is_null());
}

TEST(Score, AnEmptyDriveIsNoDivisionByZero) {
  const ScoreTable table = Score({}, {}, {}, 0);
  EXPECT_EQ(table.num_frames, 0);
  EXPECT_EQ(table.Share(0), 0.0);
  EXPECT_FALSE(table.nees_median);
  EXPECT_NE(table.ToText().find("NEES median (expected 3.36)        -"), std::string::npos);
  EXPECT_TRUE(nlohmann::json::accept(table.ToJson()));
}

TEST(ScoreTable, TextAndJsonHaveEveryRow) {
  Trial run;
  run.AddFix(0.1);
  run.AddFix(9);
  run.AddNoFix();
  const ScoreTable table = run.Table();
  const std::string text = table.ToText();
  for (const char* row :
       {"frames", "fix", "within (0.25 m, 2 deg)", "within (5 m, 10 deg)", "position error",
        "attitude error", "false fixes (> 5 m)", "longest gap", "NEES median", "resident memory",
        "bundle per km", "comparisons avoided"}) {
    EXPECT_NE(text.find(row), std::string::npos) << row;
  }
  const auto json = nlohmann::json::parse(table.ToJson());
  EXPECT_EQ(json["num_frames"], 3);
  EXPECT_EQ(json["num_false_fixes"], 1);
  EXPECT_NEAR(json["share_fix"].get<double>(), 2.0 / 3, kTolerance);
  EXPECT_NEAR(json["share_within"][0]["share"].get<double>(), 1.0 / 3, kTolerance);
  ASSERT_EQ(json["frames"].size(), 3U);
  EXPECT_NEAR(json["frames"][1]["position_error_m"].get<double>(), 9, kTolerance_m);
  EXPECT_FALSE(json["frames"][2].contains("position_error_m"));
}

}  // namespace
}  // namespace panofix
