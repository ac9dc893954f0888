#include "builder/pipeline/run_report.h"

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

nlohmann::ordered_json ListJson(const std::vector<SetAside>& entries) {
  auto list = nlohmann::ordered_json::array();
  for (const SetAside& entry : entries)
    list.push_back({{"id", entry.id}, {"reason", entry.reason}});
  return list;
}

}  // namespace

std::string RunReport::ToJson() const {
  nlohmann::ordered_json j;
  j["bundle_id"] = bundle_id;
  j["num_panoramas"] = num_panoramas;
  j["num_views"] = num_views;
  j["num_features"] = num_features;
  j["bundle_bytes"] = bundle_bytes;
  j["peak_memory_bytes"] = peak_memory_bytes;
  j["stages"] = nlohmann::ordered_json::array();
  for (const StageReport& s : stages) {
    j["stages"].push_back({{"name", s.name},
                           {"duration_s", s.duration_s},
                           {"num_items", s.num_items},
                           {"num_reused", s.num_reused},
                           {"unit", s.unit}});
  }
  j["set_aside"] = ListJson(set_aside);
  j["without_depth"] = ListJson(without_depth);
  return j.dump(1) + "\n";
}

std::string RunReport::ToTable() const {
  std::string text = Format("%-12s %10s %10s %10s\n", "stage", "seconds", "done", "reused");
  for (const StageReport& s : stages) {
    text += Format("%-12s %10.1f %10ld %10ld %s\n", s.name.c_str(), s.duration_s,
                   static_cast<long>(s.num_items - s.num_reused), static_cast<long>(s.num_reused),
                   s.unit.c_str());
  }
  text += Format("map: %ld panoramas, %ld views, %ld features, %.1f MB; peak memory %.0f MB\n",
                 static_cast<long>(num_panoramas), static_cast<long>(num_views),
                 static_cast<long>(num_features), static_cast<double>(bundle_bytes) / 1e6,
                 static_cast<double>(peak_memory_bytes) / 1e6);
  List("set aside", set_aside, &text);
  List("without depth (they serve retrieval only)", without_depth, &text);
  return text;
}

}  // namespace panofix
