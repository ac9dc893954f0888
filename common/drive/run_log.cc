#include "common/drive/run_log.h"

#include <fstream>
#include <nlohmann/json.hpp>

namespace panofix {
namespace {

using Json = nlohmann::ordered_json;
constexpr std::pair<const char*, double StageLatency::*> kStages[] = {
    {"preprocess_ms", &StageLatency::preprocess_ms},
    {"features_ms", &StageLatency::features_ms},
    {"retrieval_ms", &StageLatency::retrieval_ms},
    {"matching_ms", &StageLatency::matching_ms},
    {"pose_ms", &StageLatency::pose_ms},
    {"total_ms", &StageLatency::total_ms}};

}  // namespace

std::string ToJson(const RunLog& log) {
  Json frames = Json::array();
  for (const RunLogEntry& entry : log.frames) {
    Json frame = {{"timestamp_ns", entry.timestamp_ns},
                  {"num_compared", entry.num_compared},
                  {"num_database", entry.num_database}};
    for (const auto& [name, member] : kStages) frame[name] = entry.latency.*member;
    frames.push_back(std::move(frame));
  }
  return Json({{"resident_memory_bytes", log.resident_memory_bytes}, {"frames", frames}}).dump(1) +
         "\n";
}

Result<RunLog> ReadRunLog(const std::filesystem::path& path) {
  std::ifstream file(path);
  if (!file)
    return Status(ErrorCode::kNotFound, path.string() + ": cannot be read; give the runtime --log");
  try {
    const Json j = Json::parse(file);
    RunLog log;
    j.at("resident_memory_bytes").get_to(log.resident_memory_bytes);
    for (const Json& frame : j.at("frames")) {
      RunLogEntry entry;
      frame.at("timestamp_ns").get_to(entry.timestamp_ns);
      frame.at("num_compared").get_to(entry.num_compared);
      frame.at("num_database").get_to(entry.num_database);
      for (const auto& [name, member] : kStages) frame.at(name).get_to(entry.latency.*member);
      log.frames.push_back(entry);
    }
    return log;
  } catch (const std::exception& error) {
    return Status(ErrorCode::kBadData,
                  path.string() + ": " + error.what() + "; run the runtime again");
  }
}

}  // namespace panofix
