#include "builder/pipeline/run_report.h"

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>

#include "common/base/log.h"

namespace panofix {
namespace {

constexpr std::size_t kMaxListed = 10;

void List(const char* title, const std::vector<SetAside>& entries, std::string* text) {
  if (entries.empty()) return;
  *text += Format("%s: %zu\n", title, entries.size());
  for (std::size_t i = 0; i < entries.size() && i < kMaxListed; ++i) {
    *text += "  " + entries[i].id + ": " + entries[i].reason + "\n";
  }
  if (entries.size() > kMaxListed) {
    *text += Format("  and %zu more; all are in the report file\n", entries.size() - kMaxListed);
  }
}

nlohmann::ordered_json RedoneJson(const std::vector<Redone>& redone) {
  auto list = nlohmann::ordered_json::array();
  for (const Redone& entry : redone) list.push_back({{"id", entry.id}, {"why", entry.why}});
  return list;
}

nlohmann::ordered_json SaturationJson(const Saturation& s) {
  return {{"num_words", s.num_words},
          {"num_used", s.num_used},
          {"mean_share", s.mean_share},
          {"typical_share", s.typical_share}};
}

// What was made again, by reason: a line each, the most frequent first.
std::string RedoneText(const std::vector<StageReport>& stages) {
  std::string text;
  for (const StageReport& stage : stages) {
    std::map<std::string, std::pair<std::size_t, std::string>> by_reason;  // count and first id
    for (const Redone& entry : stage.redone) {
      auto& [count, first] = by_reason[entry.why];
      if (++count == 1) first = entry.id;
    }
    std::size_t num_shown = 0;
    for (const auto& [why, found] : by_reason) {
      if (++num_shown > kMaxListed) {
        text += "  and more; all are in the report file\n";
        break;
      }
      text += Format("  %s %s", stage.name.c_str(), found.second.c_str());
      if (found.first > 1) text += Format(" and %zu more", found.first - 1);
      text += ": " + why + "\n";
    }
  }
  return text.empty() ? text : "made again, because of:\n" + text;
}

nlohmann::ordered_json ListJson(const std::vector<SetAside>& entries) {
  auto list = nlohmann::ordered_json::array();
  for (const SetAside& entry : entries)
    list.push_back({{"id", entry.id}, {"reason", entry.reason}});
  return list;
}

nlohmann::ordered_json RefinedJson(const std::vector<RefinementReport>& refined) {
  auto list = nlohmann::ordered_json::array();
  for (const RefinementReport& r : refined) {
    list.push_back({{"id", r.id},
                    {"shift_m", r.shift_m},
                    {"turn_deg", r.turn_deg},
                    {"residual_before_px", r.residual_before_px},
                    {"residual_after_px", r.residual_after_px},
                    {"num_tracks", r.num_tracks},
                    {"is_flagged", r.is_flagged}});
  }
  return list;
}

// One line: what happened to the panoramas' poses, and who is flagged.
std::string RefinedText(const std::vector<RefinementReport>& refined) {
  std::vector<double> shifts_m, before_px, after_px;
  std::string flagged;
  for (const RefinementReport& r : refined) {
    if (r.is_flagged) flagged += (flagged.empty() ? "" : ", ") + r.id;
    if (r.num_tracks == 0) continue;
    shifts_m.push_back(r.shift_m);
    before_px.push_back(r.residual_before_px);
    after_px.push_back(r.residual_after_px);
  }
  if (shifts_m.empty()) return "";
  const auto median = [](std::vector<double>& values) {
    std::nth_element(values.begin(),
                     values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
    return values[values.size() / 2];
  };
  const double largest_m = *std::max_element(shifts_m.begin(), shifts_m.end());
  std::string text = Format(
      "poses: shifted by %.3f m (median), %.3f m at most; tracks' residuals %.2f px before, "
      "%.2f px after\n",
      median(shifts_m), largest_m, median(before_px), median(after_px));
  if (!flagged.empty()) text += "geotags that do not suit their neighbours: " + flagged + "\n";
  return text;
}

}  // namespace

std::string RunReport::ToJson() const {
  nlohmann::ordered_json j;
  j["bundle_id"] = bundle_id;
  j["num_panoramas"] = num_panoramas;
  j["num_stations"] = num_stations;
  j["num_views"] = num_views;
  j["num_landmarks"] = num_landmarks;
  j["bundle_bytes"] = bundle_bytes;
  j["peak_memory_bytes"] = peak_memory_bytes;
  j["vocabulary_release"] = vocabulary_release;
  if (saturation) j["saturation"] = SaturationJson(*saturation);
  j["stages"] = nlohmann::ordered_json::array();
  for (const StageReport& s : stages) {
    j["stages"].push_back({{"name", s.name},
                           {"duration_s", s.duration_s},
                           {"num_items", s.num_items},
                           {"num_reused", s.num_reused},
                           {"unit", s.unit},
                           {"num_units", s.num_units},
                           {"num_units_run", s.num_units_run},
                           {"num_bytes_written", s.num_bytes_written},
                           {"peak_memory_bytes", s.peak_memory_bytes},
                           {"result_sha256", s.result_sha256},
                           {"redone", RedoneJson(s.redone)}});
  }
  j["refined"] = RefinedJson(refined);
  j["set_aside"] = ListJson(set_aside);
  j["without_depth"] = ListJson(without_depth);
  return j.dump(1) + "\n";
}

std::string RunReport::ToTable() const {
  std::string text = Format("%-12s %10s %10s %10s %10s %10s\n", "stage", "seconds", "done",
                            "reused", "MB written", "peak MB");
  for (const StageReport& s : stages) {
    text +=
        Format("%-12s %10.1f %10lld %10lld %10.1f %10.0f %s\n", s.name.c_str(), s.duration_s,
               static_cast<long long>(s.num_items - s.num_reused),
               static_cast<long long>(s.num_reused), static_cast<double>(s.num_bytes_written) / 1e6,
               static_cast<double>(s.peak_memory_bytes) / 1e6, s.unit.c_str());
  }
  text += Format(
      "map: %ld panoramas, %ld stations, %ld views, %ld landmarks, %.1f MB; peak memory %.0f MB\n",
      static_cast<long>(num_panoramas), static_cast<long>(num_stations),
      static_cast<long>(num_views), static_cast<long>(num_landmarks),
      static_cast<double>(bundle_bytes) / 1e6, static_cast<double>(peak_memory_bytes) / 1e6);
  if (saturation) {
    text += Format(
        "vocabulary %s: %lld of %lld words in use; a view's word is in %.2f %% of the views\n",
        vocabulary_release.c_str(), static_cast<long long>(saturation->num_used),
        static_cast<long long>(saturation->num_words), 100 * saturation->typical_share);
  }
  text += RefinedText(refined);
  text += RedoneText(stages);
  List("set aside", set_aside, &text);
  List("without depth (they serve retrieval only)", without_depth, &text);
  return text;
}

}  // namespace panofix
