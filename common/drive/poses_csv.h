#pragma once
// poses.csv and its sister formats: what the runtime answers, one row a frame.

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/geo/map_frame.h"
#include "common/geometry/attitude.h"

namespace panofix {

enum class FixStatus { kFix, kDegraded, kNoFix };
[[nodiscard]] const char* FixStatusName(FixStatus status);  // "fix", "degraded", "no_fix"

// The pose columns of one row.
struct PoseColumns {
  Geodetic position;
  Attitude attitude;                                                 // of the camera's body
  Eigen::Quaterniond enu_from_cam = Eigen::Quaterniond::Identity();  // columns qx qy qz qw
  double sigma_east_m = 0, sigma_north_m = 0, sigma_up_m = 0, sigma_heading_deg = 0;
};

struct PoseRow {
  std::int64_t timestamp_ns = 0;
  FixStatus status = FixStatus::kNoFix;
  std::string reason;               // why not, where status is kNoFix or kDegraded
  std::optional<PoseColumns> pose;  // absent exactly where status is kNoFix
  int num_inliers = 0, num_views = 0;
  std::string best_panorama;
  double latency_ms = 0;
  bool map_is_unsigned = true;  // no signature of the bundle was verified: for development only
};

enum class PoseFormat { kCsv, kTum, kGeoJson, kGpx };
[[nodiscard]] Result<PoseFormat> ParsePoseFormat(
    const std::string& name);  // csv, tum, geojson, gpx

// The text of a whole file. TUM positions are local metres east, north, up of the first pose (a
// comment line gives its origin); rows without a pose are left out of all formats but csv.
[[nodiscard]] std::string FormatPoses(const std::vector<PoseRow>& rows, PoseFormat format);
// The same csv piece by piece, for a file that grows; each ends in a line break.
[[nodiscard]] std::string PosesCsvHeader();
[[nodiscard]] std::string PosesCsvRow(const PoseRow& row);
// Reads what FormatPoses(…, kCsv) wrote.
[[nodiscard]] Result<std::vector<PoseRow>> ReadPosesCsv(const std::filesystem::path& path);

}  // namespace panofix
