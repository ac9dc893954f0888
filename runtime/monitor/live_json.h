#pragma once
// What the live page asks for, as JSON.

#include <string>

#include "runtime/monitor/service_monitor.h"

namespace panofix {

// {"uptime_s", "bundle", "counts", "trail": […]}; positions [lat, lon] in degrees.
[[nodiscard]] std::string LiveJson(const MonitorSnapshot& snapshot,
                                   const std::vector<TrailPoint>& trail);
// {"id", "panoramas": [[lat, lon], …], "links": [[i, j], …]}
[[nodiscard]] std::string RouteJson(const MapFacts& facts);

}  // namespace panofix
