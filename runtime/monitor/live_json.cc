#include "runtime/monitor/live_json.h"

#include <nlohmann/json.hpp>

namespace panofix {
namespace {

using Json = nlohmann::ordered_json;

// Text from the wire or a map may be anything; a page must never fail over it.
std::string Dump(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

Json PointJson(const TrailPoint& p) {
  Json json{{"n", p.number},
            // Text: a browser's numbers do not hold nanoseconds.
            {"timestamp_ns", std::to_string(p.timestamp_ns)},
            {"status", FixStatusName(p.status)},
            {"reason", p.reason},
            {"inliers", p.num_inliers},
            {"panorama", p.best_panorama}};
  if (p.position) {
    json["at"] = {p.position->lat_deg, p.position->lon_deg, p.position->height_m};
    json["heading_deg"] = p.heading_deg;
    json["sigma"] = {p.sigma_long_m, p.sigma_short_m, p.sigma_turn_deg};
  }
  Json stages;
  for (std::size_t i = 0; i < kNumServiceStages; ++i) {
    stages[ServiceStageName(static_cast<ServiceStage>(i))] = p.stages_ms[i];
  }
  json["ms"] = stages;
  return json;
}

}  // namespace

std::string LiveJson(const MonitorSnapshot& s, const std::vector<TrailPoint>& trail) {
  Json points = Json::array();
  for (const TrailPoint& point : trail) points.push_back(PointJson(point));
  return Dump({{"uptime_s", s.uptime_s},
               {"bundle",
                {{"name", s.bundle.name},
                 {"id", s.bundle.id},
                 {"build", s.bundle.build},
                 {"is_signed", s.bundle.is_signed}}},
               {"counts",
                {{"frames", s.feed.frames},
                 {"replaced", s.feed.replaced},
                 {"answers", s.num_answers},
                 {"fixes", s.num_fixes},
                 {"refused", s.num_refused},
                 {"disconnects", s.feed.disconnects},
                 {"swaps", s.num_swaps}}},
               {"trail", points}});
}

std::string RouteJson(const MapFacts& facts) {
  Json panoramas = Json::array(), links = Json::array();
  for (const Geodetic& p : facts.panoramas) panoramas.push_back({p.lat_deg, p.lon_deg});
  for (const auto& [from, to] : facts.links) links.push_back({from, to});
  return Dump({{"id", facts.bundle.id}, {"panoramas", panoramas}, {"links", links}});
}

std::string SightJson(const FramePicture& picture) {
  if (!picture.sight) return "null";
  const FrameSight& sight = *picture.sight;
  Json pairs = Json::array(), landmarks = Json::array();
  for (const FrameSight::Pair& p : sight.pairs)
    pairs.push_back({p.frame_px.x(), p.frame_px.y(), p.view_px.x(), p.view_px.y()});
  for (const Eigen::Vector2f& px : sight.landmarks_px) landmarks.push_back({px.x(), px.y()});
  return Dump({{"timestamp_ns", std::to_string(picture.timestamp_ns)},
               {"panorama", sight.panorama},
               {"yaw_deg", sight.yaw_deg},
               {"from_panorama_m", sight.from_panorama_m},
               {"size", {sight.width_px, sight.height_px}},
               {"pairs", pairs},
               {"landmarks", landmarks}});
}

}  // namespace panofix
