#pragma once
// The counts in Prometheus' text format, version 0.0.4.

#include <string>

#include "runtime/monitor/service_monitor.h"

namespace panofix {

// What the process itself uses, beside what the service counts.
struct ProcessUse {
  std::uint64_t resident_memory_bytes = 0;
  double cpu_s = 0;
};
[[nodiscard]] ProcessUse ReadProcessUse();

// Each metric with HELP and TYPE; times in seconds, sizes in bytes. `now_s`: seconds since 1970.
[[nodiscard]] std::string ToPrometheusText(const MonitorSnapshot& snapshot, const ProcessUse& use,
                                           std::int64_t now_s);

}  // namespace panofix
