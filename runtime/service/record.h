#pragma once
// Writes the poses that a runtime publishes to a poses.csv.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "common/base/status.h"
#include "runtime/service/wire_security.h"

namespace panofix {

struct RecordOptions {
  std::string poses;  // endpoint of the runtime: connected to, or bound where it holds a '*'
  std::filesystem::path out;                 // poses.csv; replaced at the end if it is there
  std::optional<std::filesystem::path> log;  // also a run log (JSON): latency by stage, comparisons
  std::int64_t count = 0;                    // stop after so many rows; 0 = no bound
  WireSecurity security;
  double idle_timeout_s = 0;  // stop after so long without a row; 0 = never
  // Told once the subscription is under way, with the endpoint.
  std::function<void(const std::string& endpoint)> on_ready;
  void Check() const;  // throws std::invalid_argument
};

// Rows go to OUT.part as they come, flushed one by one, so that a crash loses nothing; the finished
// file takes its name at the end: at `count`, at the idle timeout, or at Ctrl-C. Payloads that do
// not verify are counted and logged. Errors: a bad option, the endpoint, the disk (kNoSpace, kIo),
// or an idle timeout without a single row (kNotFound; no file is left).
[[nodiscard]] Status Record(const RecordOptions& options);

}  // namespace panofix
