// Reports of single units, and how they add up.
#include <cmath>
#include <nlohmann/json.hpp>

#include "builder/pipeline/run_report.h"

namespace panofix {

using Json = nlohmann::json;

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Redone, id, why)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Saturation, num_words, num_used, mean_share, typical_share)

Saturation SaturationOf(std::span<const float> idf) {
  Saturation s;
  s.num_words = static_cast<std::int64_t>(idf.size());
  double sum = 0, sum_sq = 0;
  for (const float value : idf) {
    if (value <= 0) continue;  // no view has it; or all, which is as good as none
    const double share = std::exp(-double{value});
    ++s.num_used;
    sum += share, sum_sq += share * share;
  }
  if (s.num_used > 0) {
    s.mean_share = sum / static_cast<double>(s.num_used);
    s.typical_share = sum_sq / sum;
  }
  return s;
}

void UnitReport::AddRedone(const std::string& id, const PartDigests* before,
                           const PartDigests& now) {
  if (before == nullptr) {
    ++num_new;
    return;
  }
  ++num_redone;
  const std::string why = WhyDifferent(*before, now);
  redone.push_back({id, why.empty() ? "its work file was gone or damaged" : why});
}

std::string UnitReport::ToJson() const {
  Json j = {{"stage", stage},
            {"unit", unit},
            {"run", run},
            {"duration_s", duration_s},
            {"num_items", num_items},
            {"num_new", num_new},
            {"num_redone", num_redone},
            {"num_set_aside", num_set_aside},
            {"num_bytes_written", num_bytes_written},
            {"peak_memory_bytes", peak_memory_bytes},
            {"redone", redone},
            {"result_sha256", result_sha256}};
  if (saturation) j["saturation"] = *saturation;
  return j.dump(1) + "\n";
}

std::optional<UnitReport> UnitReport::Parse(const std::string& json) {
  try {
    const Json j = Json::parse(json);
    UnitReport report{j.at("stage"),
                      j.at("unit"),
                      j.at("run"),
                      j.at("duration_s"),
                      j.at("num_items"),
                      j.at("num_new"),
                      j.at("num_redone"),
                      j.at("num_set_aside"),
                      j.at("num_bytes_written"),
                      j.at("peak_memory_bytes"),
                      j.at("redone").get<std::vector<Redone>>(),
                      std::nullopt,
                      j.at("result_sha256")};
    if (j.contains("saturation")) report.saturation = j.at("saturation").get<Saturation>();
    return report;
  } catch (const Json::exception&) {
    return std::nullopt;
  }
}

void StageReport::Add(const UnitReport& report) {
  ++num_units_run;
  duration_s += report.duration_s;
  num_bytes_written += report.num_bytes_written;
  peak_memory_bytes = std::max(peak_memory_bytes, report.peak_memory_bytes);
  num_items += report.num_items;
  num_reused += report.num_items - report.num_new - report.num_redone;
  redone.insert(redone.end(), report.redone.begin(), report.redone.end());
}

}  // namespace panofix
