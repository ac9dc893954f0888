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

// {"timestamp_ns", "panorama", "yaw_deg", "from_panorama_m", "size": [w, h], "pairs": [[x, y in the
// frame, x, y in the view], …], "landmarks": [[x, y], …]}, pixels; null without a sight.
[[nodiscard]] std::string SightJson(const FramePicture& picture);

}  // namespace panofix
