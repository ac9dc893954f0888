#include "common/drive/poses_csv.h"

#include "common/base/log.h"
#include "common/drive/csv.h"
#include "common/drive/poses_export.h"

namespace panofix {
namespace {

const std::vector<std::string>& Columns() {
  static const std::vector<std::string> columns{"timestamp_ns",
                                                "status",
                                                "reason",
                                                "latitude",
                                                "longitude",
                                                "altitude",
                                                "heading",
                                                "pitch",
                                                "roll",
                                                "qx",
                                                "qy",
                                                "qz",
                                                "qw",
                                                "sigma_east_m",
                                                "sigma_north_m",
                                                "sigma_up_m",
                                                "sigma_heading_deg",
                                                "num_inliers",
                                                "num_views",
                                                "best_panorama",
                                                "latency_ms",
                                                "map_is_unsigned"};
  return columns;
}

// Places of columns in Columns().
enum Column : std::size_t {
  kTimestamp,
  kStatus,
  kReason,
  kLatitude,
  kLongitude,
  kAltitude,
  kHeading,
  kPitch,
  kRoll,
  kQx,
  kQy,
  kQz,
  kQw,
  kSigmaEast,
  kSigmaNorth,
  kSigmaUp,
  kSigmaHeading,
  kNumInliers,
  kNumViews,
  kBestPanorama,
  kLatency,
  kMapIsUnsigned
};
constexpr std::size_t kNumPoseColumns = kSigmaHeading - kLatitude + 1;
constexpr std::size_t kNumOptionalColumns = 1;  // at the end; files of 0.1.0 lack them
constexpr double kMaxHeightM = 1e5, kMaxAngleDeg = 1e4, kMaxSigma = 1e9, kMaxLatencyMs = 1e9;
constexpr double kUnitQuaternionTolerance = 1e-3;  // rounding to 9 decimals costs 1e-9

std::string PoseText(const PoseColumns& pose) {
  std::string heading = Format("%.6f", pose.attitude.heading_deg);
  if (heading == "360.000000") heading = "0.000000";  // 359.9999999 rounds out of its range
  const Eigen::Quaterniond& q = pose.enu_from_cam;
  return Format("%.10f,%.10f,%.4f,%s,%.6f,%.6f,", pose.position.lat_deg, pose.position.lon_deg,
                pose.position.height_m, heading.c_str(), pose.attitude.pitch_deg,
                pose.attitude.roll_deg) +
         Format("%.9f,%.9f,%.9f,%.9f,%.4f,%.4f,%.4f,%.4f", q.x(), q.y(), q.z(), q.w(),
                pose.sigma_east_m, pose.sigma_north_m, pose.sigma_up_m, pose.sigma_heading_deg);
}

Status ReadStatus(const CsvReader& table, FixStatus& status) {
  for (const FixStatus known : {FixStatus::kFix, FixStatus::kDegraded, FixStatus::kNoFix}) {
    if (table.Text(kStatus) != FixStatusName(known)) continue;
    status = known;
    return {};
  }
  return table.Bad("status '" + table.Text(kStatus) + "' is unknown",
                   "write fix, degraded or no_fix");
}

Result<PoseColumns> ReadPose(const CsvReader& table) {
  PoseColumns pose;
  double q[4];
  struct Field {
    Column column;
    double low, high;
    double* value;
  };
  const Field fields[] = {{kLatitude, -90, 90, &pose.position.lat_deg},
                          {kLongitude, -180, 180, &pose.position.lon_deg},
                          {kAltitude, -kMaxHeightM, kMaxHeightM, &pose.position.height_m},
                          {kHeading, -kMaxAngleDeg, kMaxAngleDeg, &pose.attitude.heading_deg},
                          {kPitch, -kMaxAngleDeg, kMaxAngleDeg, &pose.attitude.pitch_deg},
                          {kRoll, -kMaxAngleDeg, kMaxAngleDeg, &pose.attitude.roll_deg},
                          {kQx, -1, 1, &q[0]},
                          {kQy, -1, 1, &q[1]},
                          {kQz, -1, 1, &q[2]},
                          {kQw, -1, 1, &q[3]},
                          {kSigmaEast, 0, kMaxSigma, &pose.sigma_east_m},
                          {kSigmaNorth, 0, kMaxSigma, &pose.sigma_north_m},
                          {kSigmaUp, 0, kMaxSigma, &pose.sigma_up_m},
                          {kSigmaHeading, 0, kMaxSigma, &pose.sigma_heading_deg}};
  static_assert(std::size(fields) == kNumPoseColumns);
  for (const Field& field : fields) {
    const Result<double> value = table.Number(field.column, field.low, field.high);
    if (!value.ok()) return value.status();
    *field.value = *value;
  }
  pose.enu_from_cam = Eigen::Quaterniond(q[3], q[0], q[1], q[2]);
  if (std::abs(pose.enu_from_cam.norm() - 1) > kUnitQuaternionTolerance) {
    return table.Bad("qx,qy,qz,qw is not a unit quaternion", "write the file again");
  }
  return pose;
}

Result<int> ReadCount(const CsvReader& table, Column column) {
  const Result<double> value = table.Number(column, 0, 1e9);
  if (!value.ok()) return value.status();
  const Result<std::int64_t> whole = table.Integer(column);
  if (!whole.ok()) return whole.status();
  return static_cast<int>(*whole);
}

Result<PoseRow> ReadRow(const CsvReader& table) {
  PoseRow row;
  const Result<std::int64_t> timestamp_ns = table.Integer(kTimestamp);
  if (!timestamp_ns.ok()) return timestamp_ns.status();
  row.timestamp_ns = *timestamp_ns;
  const Status status = ReadStatus(table, row.status);
  if (!status.ok()) return status;
  row.reason = table.Text(kReason);
  row.best_panorama = table.Text(kBestPanorama);
  if (row.status != FixStatus::kNoFix) {
    const Result<PoseColumns> pose = ReadPose(table);
    if (!pose.ok()) return pose.status();
    row.pose = *pose;
  } else if (!table.IsBlank(kLatitude)) {
    return table.Bad("a row of status no_fix holds a pose", "leave its pose columns blank");
  }
  const Result<int> num_inliers = ReadCount(table, kNumInliers);
  if (!num_inliers.ok()) return num_inliers.status();
  const Result<int> num_views = ReadCount(table, kNumViews);
  if (!num_views.ok()) return num_views.status();
  const Result<double> latency_ms = table.Number(kLatency, 0, kMaxLatencyMs);
  if (!latency_ms.ok()) return latency_ms.status();
  // Unsaid counts as unsigned.
  const std::string& unsigned_text = table.Text(kMapIsUnsigned);
  if (!table.IsBlank(kMapIsUnsigned) && unsigned_text != "0" && unsigned_text != "1")
    return table.Bad("map_is_unsigned '" + unsigned_text + "' is unknown", "write 0 or 1");
  row.map_is_unsigned = unsigned_text != "0";
  row.num_inliers = *num_inliers, row.num_views = *num_views, row.latency_ms = *latency_ms;
  return row;
}

}  // namespace

const char* FixStatusName(FixStatus status) {
  switch (status) {
    case FixStatus::kFix:
      return "fix";
    case FixStatus::kDegraded:
      return "degraded";
    case FixStatus::kNoFix:
      return "no_fix";
  }
  return "no_fix";
}

std::string PosesCsvHeader() {
  std::string text;
  for (const std::string& column : Columns()) text += (text.empty() ? "" : ",") + column;
  return text + '\n';
}

std::string PosesCsvRow(const PoseRow& row) {
  return Format("%lld,%s,", static_cast<long long>(row.timestamp_ns), FixStatusName(row.status)) +
         CsvField(row.reason) + ',' +
         (row.pose ? PoseText(*row.pose) : std::string(kNumPoseColumns - 1, ',')) +
         Format(",%d,%d,", row.num_inliers, row.num_views) + CsvField(row.best_panorama) +
         Format(",%.3f,%d\n", row.latency_ms, row.map_is_unsigned ? 1 : 0);
}

Result<PoseFormat> ParsePoseFormat(const std::string& name) {
  if (name == "csv") return PoseFormat::kCsv;
  if (name == "tum") return PoseFormat::kTum;
  if (name == "geojson") return PoseFormat::kGeoJson;
  if (name == "gpx") return PoseFormat::kGpx;
  return Status(ErrorCode::kInvalidArgument,
                "format '" + name + "' is unknown; choose csv, tum, geojson or gpx");
}

std::string FormatPoses(const std::vector<PoseRow>& rows, PoseFormat format) {
  std::string csv;
  switch (format) {
    case PoseFormat::kCsv:
      csv = PosesCsvHeader();
      for (const PoseRow& row : rows) csv += PosesCsvRow(row);
      return csv;
    case PoseFormat::kTum:
      return FormatTum(rows);
    case PoseFormat::kGeoJson:
      return FormatGeoJson(rows);
    case PoseFormat::kGpx:
      return FormatGpx(rows);
  }
  return {};
}

Result<std::vector<PoseRow>> ReadPosesCsv(const std::filesystem::path& path) {
  Result<CsvReader> table = CsvReader::Open(path, Columns(), kNumOptionalColumns);
  if (!table.ok()) return table.status();
  std::vector<PoseRow> rows;
  while (true) {
    const Result<bool> more = table->Next();
    if (!more.ok()) return more.status();
    if (!*more) return rows;
    Result<PoseRow> row = ReadRow(*table);
    if (!row.ok()) return row.status();
    rows.push_back(std::move(row).value());
  }
}

}  // namespace panofix
