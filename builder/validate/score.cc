#include "builder/validate/score.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "common/base/log.h"

namespace panofix {
namespace {

// Nearest rank; 0 for nothing.
double Quantile(std::vector<double> values, double q) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  const auto rank = static_cast<std::size_t>(std::ceil(q * static_cast<double>(values.size())));
  return values[std::clamp<std::size_t>(rank, 1, values.size()) - 1];
}

// Mean of the two middle values where their number is even; 0 for nothing.
double Median(std::vector<double> values) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return 0.5 * (values[(values.size() - 1) / 2] + values[values.size() / 2]);
}

// Error in the truth's east-north-up, metres. The tangent plane of the map frame at the truth is
// Euclidean to micrometres over the metres that matter.
Eigen::Vector3d ErrorEnu(const Geodetic& estimate, const Geodetic& truth) {
  const MapFrame plane = MapFrame::Tangent(truth);
  return plane.MapFromEnu(truth).transpose() * (plane.ToMap(estimate) - plane.ToMap(truth));
}

FrameScore ScoreFrame(const PoseRow& row, const TruthPose& truth) {
  FrameScore score;
  score.timestamp_ns = row.timestamp_ns;
  score.status = row.status;
  score.has_truth = true;
  score.has_attitude_truth = truth.attitude.has_value();
  if (!row.pose) return score;
  const Eigen::Vector3d error = ErrorEnu(row.pose->position, truth.position);
  score.position_error_m = error.norm();
  const PoseColumns& p = *row.pose;
  double nees = std::pow(error.x() / p.sigma_east_m, 2) + std::pow(error.y() / p.sigma_north_m, 2) +
                std::pow(error.z() / p.sigma_up_m, 2);
  if (truth.attitude) {
    const Eigen::Matrix3d relative =
        EnuFromBody(*truth.attitude).transpose() * EnuFromBody(p.attitude);
    score.attitude_error_deg = Eigen::AngleAxisd(relative).angle() / kRadPerDeg;
    nees += std::pow(AngleDifferenceDeg(p.attitude.heading_deg, truth.attitude->heading_deg) /
                         p.sigma_heading_deg,
                     2);
    if (std::isfinite(nees)) score.nees = nees;
  }
  return score;
}

// A table of zeros would read as a verdict where nothing was compared.
void RefuseUnrelated(const ScoreTable& table,
                     const std::map<std::int64_t, const PoseRow*>& row_of) {
  if (table.num_frames == 0) return;
  if (table.num_with_truth == 0) {
    throw Error(
        ErrorCode::kBadData,
        "no frame has a truth of its own time; frames.csv and truth.csv do not belong together");
  }
  const bool related =
      std::any_of(table.frames.begin(), table.frames.end(),
                  [&](const FrameScore& f) { return row_of.count(f.timestamp_ns) > 0; });
  if (!row_of.empty() && !related) {
    throw Error(ErrorCode::kBadData,
                "no pose has the time of a frame; the poses are of another drive");
  }
}

void SummarizeLog(const RunLog& log, ScoreTable* table) {
  constexpr std::pair<const char*, double StageLatency::*> kStages[] = {
      {"preprocess", &StageLatency::preprocess_ms},
      {"features", &StageLatency::features_ms},
      {"retrieval", &StageLatency::retrieval_ms},
      {"matching", &StageLatency::matching_ms},
      {"pose", &StageLatency::pose_ms},
      {"total", &StageLatency::total_ms}};
  if (log.frames.empty()) return;
  std::int64_t compared = 0, database = 0;
  for (const auto& [name, member] : kStages) {
    std::vector<double> values;
    for (const RunLogEntry& entry : log.frames) values.push_back(entry.latency.*member);
    table->latency_ms.emplace_back(
        name, Percentiles{Quantile(values, 0.5), Quantile(values, 0.95), Quantile(values, 0.99)});
  }
  for (const RunLogEntry& entry : log.frames) {
    compared += entry.num_compared;
    database += entry.num_database;
  }
  if (database > 0)
    table->comparisons_avoided = 1 - static_cast<double>(compared) / static_cast<double>(database);
  table->resident_memory_mb = static_cast<double>(log.resident_memory_bytes) / 1e6;
}

}  // namespace

double ScoreTable::Share(int count) const {
  return num_frames > 0 ? static_cast<double>(count) / num_frames : 0;
}

ScoreTable Score(const Drive& drive, const std::vector<PoseRow>& poses, const RunLog& log,
                 double bundle_mb_per_km) {
  std::map<std::int64_t, const PoseRow*> row_of;
  for (const PoseRow& row : poses) {
    if (!row_of.emplace(row.timestamp_ns, &row).second) {
      throw Error(ErrorCode::kBadData,
                  Format("poses: time %lld twice; one row a frame is what a score can read",
                         static_cast<long long>(row.timestamp_ns)));
    }
  }
  std::map<std::int64_t, const TruthPose*> truth_of;
  for (const TruthPose& truth : drive.truth) truth_of.emplace(truth.timestamp_ns, &truth);

  ScoreTable table;
  std::vector<double> position_m, attitude_deg, nees;
  int gap = 0;
  for (const DriveFrame& frame : drive.frames) {
    const auto row = row_of.find(frame.timestamp_ns);
    const auto truth = truth_of.find(frame.timestamp_ns);
    FrameScore score;
    score.timestamp_ns = frame.timestamp_ns;
    if (row != row_of.end() && truth != truth_of.end()) {
      score = ScoreFrame(*row->second, *truth->second);
    } else if (row != row_of.end()) {
      score.status = row->second->status;
    } else {
      score.has_truth = truth != truth_of.end();
    }
    ++table.num_frames;
    table.num_with_truth += score.has_truth;
    table.num_degraded += score.status == FixStatus::kDegraded;
    const bool fixed = score.status == FixStatus::kFix;
    gap = fixed ? 0 : gap + 1;
    table.longest_gap_frames = std::max(table.longest_gap_frames, gap);
    table.num_fixes += fixed;
    if (fixed && score.has_truth) {
      position_m.push_back(score.position_error_m);
      if (score.has_attitude_truth) attitude_deg.push_back(score.attitude_error_deg);
      if (score.nees) nees.push_back(*score.nees);
      table.num_false_fixes += score.position_error_m > kFalseFix_m;
      for (std::size_t b = 0; b < kAccuracyBands.size(); ++b) {
        table.num_within[b] += score.position_error_m <= kAccuracyBands[b].position_m &&
                               score.attitude_error_deg <= kAccuracyBands[b].attitude_deg;
      }
    }
    table.frames.push_back(score);
  }
  RefuseUnrelated(table, row_of);
  table.num_scored = static_cast<int>(position_m.size());
  table.num_attitude_scored = static_cast<int>(attitude_deg.size());
  table.median_position_error_m = Median(position_m);
  table.p95_position_error_m = Quantile(position_m, 0.95);
  table.median_attitude_error_deg = Median(attitude_deg);
  table.p95_attitude_error_deg = Quantile(attitude_deg, 0.95);
  if (!nees.empty()) table.nees_median = Median(nees);
  table.bundle_mb_per_km = bundle_mb_per_km;
  SummarizeLog(log, &table);
  return table;
}

std::string ScoreTable::ToText() const {
  std::string text;
  const auto row = [&](const std::string& name, const std::string& value) {
    text += Format("%-34s %s\n", name.c_str(), value.c_str());
  };
  const auto share = [&](int count) {
    return Format("%5.1f %%  (%d of %d)", 100 * Share(count), count, num_frames);
  };
  row("frames", Format("%d, %d with truth", num_frames, num_with_truth));
  row("fix", share(num_fixes));
  row("degraded", share(num_degraded));
  for (std::size_t b = 0; b < kAccuracyBands.size(); ++b) {
    row(Format("within (%g m, %g deg)", kAccuracyBands[b].position_m,
               kAccuracyBands[b].attitude_deg),
        share(num_within[b]));
  }
  row("position error of fixes",
      num_scored == 0
          ? std::string("-")
          : Format("median %.3f m, 95 %% %.3f m", median_position_error_m, p95_position_error_m));
  row("attitude error of fixes", num_attitude_scored == 0
                                     ? std::string("-")
                                     : Format("median %.3f deg, 95 %% %.3f deg",
                                              median_attitude_error_deg, p95_attitude_error_deg));
  row(Format("false fixes (> %g m)", kFalseFix_m), share(num_false_fixes));
  row("longest gap without a fix", Format("%d frames", longest_gap_frames));
  row("NEES median (expected 3.36)", nees_median ? Format("%.2f", *nees_median) : std::string("-"));
  for (const auto& [stage, p] : latency_ms) {
    row("latency " + stage, Format("p50 %.1f  p95 %.1f  p99 %.1f ms", p.p50, p.p95, p.p99));
  }
  row("resident memory",
      resident_memory_mb > 0 ? Format("%.0f MB", resident_memory_mb) : std::string("-"));
  row("bundle per km of route",
      bundle_mb_per_km > 0 ? Format("%.1f MB", bundle_mb_per_km) : std::string("-"));
  row("database comparisons avoided",
      latency_ms.empty() ? std::string("-") : Format("%.1f %%", 100 * comparisons_avoided));
  return text;
}

std::string ScoreTable::ToJson() const {
  nlohmann::ordered_json j = {{"num_frames", num_frames},
                              {"num_with_truth", num_with_truth},
                              {"num_fixes", num_fixes},
                              {"share_fix", Share(num_fixes)},
                              {"share_degraded", Share(num_degraded)},
                              {"num_false_fixes", num_false_fixes},
                              {"share_false_fixes", Share(num_false_fixes)},
                              {"median_position_error_m", median_position_error_m},
                              {"p95_position_error_m", p95_position_error_m},
                              {"median_attitude_error_deg", median_attitude_error_deg},
                              {"p95_attitude_error_deg", p95_attitude_error_deg},
                              {"longest_gap_frames", longest_gap_frames},
                              {"resident_memory_mb", resident_memory_mb},
                              {"bundle_mb_per_km", bundle_mb_per_km},
                              {"comparisons_avoided", comparisons_avoided}};
  // Unsaid, not zero, where nothing was compared.
  if (num_scored == 0) j["median_position_error_m"] = j["p95_position_error_m"] = nullptr;
  if (num_attitude_scored == 0)
    j["median_attitude_error_deg"] = j["p95_attitude_error_deg"] = nullptr;
  j["nees_median"] = nees_median ? nlohmann::ordered_json(*nees_median) : nlohmann::ordered_json();
  for (std::size_t b = 0; b < kAccuracyBands.size(); ++b) {
    j["share_within"].push_back({{"position_m", kAccuracyBands[b].position_m},
                                 {"attitude_deg", kAccuracyBands[b].attitude_deg},
                                 {"share", Share(num_within[b])}});
  }
  for (const auto& [stage, p] : latency_ms) {
    j["latency_ms"][stage] = {{"p50", p.p50}, {"p95", p.p95}, {"p99", p.p99}};
  }
  for (const FrameScore& f : frames) {
    nlohmann::ordered_json frame = {{"timestamp_ns", f.timestamp_ns},
                                    {"status", FixStatusName(f.status)}};
    if (f.has_truth && f.status != FixStatus::kNoFix) {
      frame["position_error_m"] = f.position_error_m;
      if (f.has_attitude_truth) frame["attitude_error_deg"] = f.attitude_error_deg;
      if (f.nees) frame["nees"] = *f.nees;
    }
    j["frames"].push_back(frame);
  }
  return j.dump(1) + "\n";
}

}  // namespace panofix
