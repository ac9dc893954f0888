#include "runtime/service/pose_lines.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "common/base/log.h"

namespace panofix {
namespace {

constexpr std::int64_t kNsPerHundredth = 10'000'000;

std::string Sentence(const std::string& body) {
  unsigned checksum = 0;
  for (const char c : body) checksum ^= static_cast<unsigned char>(c);
  return "$" + body + Format("*%02X\r\n", checksum);
}

// hhmmss.ss of the day.
std::string TimeOfDay(std::int64_t timestamp_ns) {
  const std::int64_t hundredths = timestamp_ns / kNsPerHundredth % (24 * 3600 * 100);
  const std::int64_t s = hundredths / 100;
  return Format("%02d%02d%02d.%02d", static_cast<int>(s / 3600), static_cast<int>(s / 60 % 60),
                static_cast<int>(s % 60), static_cast<int>(hundredths % 100));
}

// Degrees and minutes, rounded as a whole so that 60 minutes never show; `width` of the degrees.
std::string DegreesMinutes(double angle_deg, int width, const char* positive,
                           const char* negative) {
  constexpr std::int64_t kPerMinute = 10'000'000;
  const auto units =
      static_cast<std::int64_t>(std::llround(std::fabs(angle_deg) * 60 * kPerMinute));
  return Format("%0*d%02d.%07d,%s", width, static_cast<int>(units / (60 * kPerMinute)),
                static_cast<int>(units / kPerMinute % 60), static_cast<int>(units % kPerMinute),
                angle_deg < 0 ? negative : positive);
}

}  // namespace

std::string ToNmea(const PoseRow& row) {
  const std::string time = TimeOfDay(row.timestamp_ns);
  if (!row.pose) return Sentence("GPGGA," + time + ",,,,,0,,,,M,,M,,");
  const PoseColumns& p = *row.pose;
  const int quality = row.status == FixStatus::kFix ? 1 : 6;
  return Sentence("GPGGA," + time + "," + DegreesMinutes(p.position.lat_deg, 2, "N", "S") + "," +
                  DegreesMinutes(p.position.lon_deg, 3, "E", "W") +
                  Format(",%d,,,%.3f,M,0.0,M,,", quality, p.position.height_m)) +
         Sentence(Format("GPHDT,%.2f,T", p.attitude.heading_deg)) +
         Sentence("GPGST," + time +
                  Format(",,,,,%.3f,%.3f,%.3f", p.sigma_north_m, p.sigma_east_m, p.sigma_up_m));
}

std::string ToGeoJsonLine(const PoseRow& row) {
  using Json = nlohmann::ordered_json;
  Json properties{{"timestamp_ns", row.timestamp_ns}, {"status", FixStatusName(row.status)}};
  if (!row.reason.empty()) properties["reason"] = row.reason;
  Json geometry;  // null
  if (row.pose) {
    const PoseColumns& p = *row.pose;
    geometry = {{"type", "Point"},
                {"coordinates", {p.position.lon_deg, p.position.lat_deg, p.position.height_m}}};
    properties["heading_deg"] = p.attitude.heading_deg;
    properties["sigma_east_m"] = p.sigma_east_m;
    properties["sigma_north_m"] = p.sigma_north_m;
  }
  const Json feature{{"type", "Feature"}, {"geometry", geometry}, {"properties", properties}};
  return feature.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace panofix
