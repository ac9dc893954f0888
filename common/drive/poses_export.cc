#include "common/drive/poses_export.h"

#include <cmath>
#include <ctime>

#include "common/base/log.h"

namespace panofix {
namespace {

constexpr double kWgs84SemiMajorM = 6378137.0;
constexpr double kWgs84Flattening = 1 / 298.257223563;
constexpr std::int64_t kNsPerS = 1'000'000'000;

// Earth-centred, earth-fixed coordinates (metres) and the axes of local east, north, up in them.
struct LocalFrame {
  Eigen::Vector3d origin_in_ecef = Eigen::Vector3d::Zero();
  Eigen::Matrix3d ecef_from_enu = Eigen::Matrix3d::Identity();
};

LocalFrame LocalFrameAt(const Geodetic& point) {
  const double lat = point.lat_deg * kRadPerDeg, lon = point.lon_deg * kRadPerDeg;
  const double sin_lat = std::sin(lat), cos_lat = std::cos(lat);
  const double sin_lon = std::sin(lon), cos_lon = std::cos(lon);
  const double e2 = kWgs84Flattening * (2 - kWgs84Flattening);
  const double normal_m = kWgs84SemiMajorM / std::sqrt(1 - e2 * sin_lat * sin_lat);
  LocalFrame frame;
  frame.origin_in_ecef << (normal_m + point.height_m) * cos_lat * cos_lon,
      (normal_m + point.height_m) * cos_lat * sin_lon,
      (normal_m * (1 - e2) + point.height_m) * sin_lat;
  frame.ecef_from_enu << -sin_lon, -sin_lat * cos_lon, cos_lat * cos_lon,  //
      cos_lon, -sin_lat * sin_lon, cos_lat * sin_lon,                      //
      0, cos_lat, sin_lat;
  return frame;
}

// Whole seconds rounded down and the rest, also before 1970.
std::pair<std::int64_t, std::int64_t> SplitSeconds(std::int64_t timestamp_ns) {
  std::int64_t seconds = timestamp_ns / kNsPerS, rest_ns = timestamp_ns % kNsPerS;
  if (rest_ns < 0) --seconds, rest_ns += kNsPerS;
  return {seconds, rest_ns};
}

std::string Utc(std::int64_t timestamp_ns) {
  const auto [seconds, rest_ns] = SplitSeconds(timestamp_ns);
  const auto time = static_cast<std::time_t>(seconds);
  std::tm utc{};
  gmtime_r(&time, &utc);
  return Format("%04d-%02d-%02dT%02d:%02d:%02d.%09lldZ", utc.tm_year + 1900, utc.tm_mon + 1,
                utc.tm_mday, utc.tm_hour, utc.tm_min, utc.tm_sec, static_cast<long long>(rest_ns));
}

// A JSON string, quotes included.
std::string JsonString(const std::string& text) {
  std::string json = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      json += '\\';
      json += c;
    } else if (static_cast<unsigned char>(c) < 0x20) {
      json += Format("\\u%04x", static_cast<unsigned int>(c));
    } else {
      json += c;
    }
  }
  return json + "\"";
}

std::string GeoJsonFeature(const PoseRow& row) {
  const PoseColumns& pose = *row.pose;
  return Format(
             "{\"type\":\"Feature\",\"geometry\":{\"type\":\"Point\",\"coordinates\":"
             "[%.10f,%.10f,%.4f]},\"properties\":{\"timestamp_ns\":%lld,\"status\":\"%s\",",
             pose.position.lon_deg, pose.position.lat_deg, pose.position.height_m,
             static_cast<long long>(row.timestamp_ns), FixStatusName(row.status)) +
         "\"reason\":" + JsonString(row.reason) +
         Format(
             ",\"heading\":%.6f,\"pitch\":%.6f,\"roll\":%.6f,\"sigma_east_m\":%.4f,"
             "\"sigma_north_m\":%.4f,\"sigma_up_m\":%.4f,\"sigma_heading_deg\":%.4f,",
             pose.attitude.heading_deg, pose.attitude.pitch_deg, pose.attitude.roll_deg,
             pose.sigma_east_m, pose.sigma_north_m, pose.sigma_up_m, pose.sigma_heading_deg) +
         Format("\"num_inliers\":%d,\"num_views\":%d,\"latency_ms\":%.3f,", row.num_inliers,
                row.num_views, row.latency_ms) +
         "\"map_is_unsigned\":" + (row.map_is_unsigned ? "true," : "false,") +
         "\"best_panorama\":" + JsonString(row.best_panorama) + "}}";
}

}  // namespace

std::string FormatTum(const std::vector<PoseRow>& rows) {
  std::string text;
  LocalFrame first;
  for (const PoseRow& row : rows) {
    if (!row.pose) continue;
    const LocalFrame local = LocalFrameAt(row.pose->position);
    if (text.empty()) {
      first = local;
      text = Format("# east, north, up metres from latitude %.10f longitude %.10f altitude %.4f\n",
                    row.pose->position.lat_deg, row.pose->position.lon_deg,
                    row.pose->position.height_m);
    }
    const Eigen::Matrix3d first_from_ecef = first.ecef_from_enu.transpose();
    const Eigen::Vector3d x = first_from_ecef * (local.origin_in_ecef - first.origin_in_ecef);
    const Eigen::Quaterniond first_from_enu(Eigen::Matrix3d(first_from_ecef * local.ecef_from_enu));
    const Eigen::Quaterniond q = first_from_enu * row.pose->enu_from_cam;
    const auto [seconds, rest_ns] = SplitSeconds(row.timestamp_ns);
    text +=
        Format("%lld.%09lld %.4f %.4f %.4f %.9f %.9f %.9f %.9f\n", static_cast<long long>(seconds),
               static_cast<long long>(rest_ns), x.x(), x.y(), x.z(), q.x(), q.y(), q.z(), q.w());
  }
  return text;
}

std::string FormatGeoJson(const std::vector<PoseRow>& rows) {
  std::string text = "{\"type\":\"FeatureCollection\",\"features\":[";
  const char* separator = "\n";
  for (const PoseRow& row : rows) {
    if (!row.pose) continue;
    text += separator + GeoJsonFeature(row);
    separator = ",\n";
  }
  return text + "\n]}\n";
}

std::string FormatGpx(const std::vector<PoseRow>& rows) {
  std::string text =
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
      "<gpx version=\"1.1\" creator=\"panofix\" xmlns=\"http://www.topografix.com/GPX/1/1\">\n"
      "<trk><name>panofix</name>\n";
  bool in_segment = false;
  for (const PoseRow& row : rows) {
    if (in_segment != row.pose.has_value()) {
      text += in_segment ? "</trkseg>\n" : "<trkseg>\n";
      in_segment = !in_segment;
    }
    if (!row.pose) continue;
    text += Format("<trkpt lat=\"%.10f\" lon=\"%.10f\"><ele>%.4f</ele><time>%s</time>",
                   row.pose->position.lat_deg, row.pose->position.lon_deg,
                   row.pose->position.height_m, Utc(row.timestamp_ns).c_str()) +
            Format("<desc>%s, heading %.2f deg, %d inliers%s</desc></trkpt>\n",
                   FixStatusName(row.status), row.pose->attitude.heading_deg, row.num_inliers,
                   row.map_is_unsigned ? ", unsigned map" : "");
  }
  if (in_segment) text += "</trkseg>\n";
  return text + "</trk>\n</gpx>\n";
}

}  // namespace panofix
