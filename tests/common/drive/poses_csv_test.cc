#include "common/drive/poses_csv.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "tests/common/io/temp_folder.h"

namespace panofix {
namespace {

// Half of the last decimal that the file keeps.
constexpr double kDegreeTolerance = 0.51e-10;
constexpr double kHeightToleranceM = 0.51e-4;
constexpr double kAngleTolerance = 0.51e-6;
constexpr double kQuaternionTolerance = 0.51e-9;
constexpr double kSigmaTolerance = 0.51e-4;

PoseRow Fix(std::int64_t timestamp_ns, const Geodetic& position, const Attitude& attitude) {
  PoseRow row;
  row.timestamp_ns = timestamp_ns;
  row.status = FixStatus::kFix;
  PoseColumns pose;
  pose.position = position;
  pose.attitude = attitude;
  pose.enu_from_cam = Eigen::Quaterniond(Eigen::Matrix3d(EnuFromBody(attitude) * BodyFromCam()));
  pose.sigma_east_m = 0.1, pose.sigma_north_m = 0.2, pose.sigma_up_m = 0.30004;
  pose.sigma_heading_deg = 0.5;
  row.pose = pose;
  row.num_inliers = 120, row.num_views = 4;
  row.best_panorama = "pano 7, \"north\"";
  row.latency_ms = 12.3456;
  return row;
}

PoseRow NoFix(std::int64_t timestamp_ns) {
  PoseRow row;
  row.timestamp_ns = timestamp_ns;
  row.reason = "too few matches, 3 of 12";
  row.latency_ms = 5;
  return row;
}

std::vector<PoseRow> SampleRows() {
  std::vector<PoseRow> rows{
      Fix(1402922358641000001, {48.85059866764, 2.33481427631, 40.25404}, {179.3809971, 4.2, -0.5}),
      NoFix(1402922359000000000), Fix(1402922360032000000, {-48.8, -2.3, -10}, {359.9999999, 0, 0}),
      Fix(-1, {0, 0, 0}, {0, 0, 0})};
  rows[2].status = FixStatus::kDegraded;
  rows[2].reason = "few views";
  rows[2].map_is_unsigned = false;
  return rows;
}

std::vector<std::string> Lines(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

TEST(PosesCsv, HeaderAndDecimalsAreTheContract) {
  const auto lines = Lines(FormatPoses(SampleRows(), PoseFormat::kCsv));
  ASSERT_EQ(lines.size(), 5U);
  EXPECT_EQ(lines[0],
            "timestamp_ns,status,reason,latitude,longitude,altitude,heading,pitch,roll,qx,qy,qz,qw,"
            "sigma_east_m,sigma_north_m,sigma_up_m,sigma_heading_deg,num_inliers,num_views,"
            "best_panorama,latency_ms,map_is_unsigned");
  EXPECT_EQ(lines[1].rfind("1402922358641000001,fix,,48.8505986676,2.3348142763,40.2540,"
                           "179.380997,4.200000,-0.500000,",
                           0),
            0U)
      << lines[1];
  EXPECT_EQ(lines[2],
            "1402922359000000000,no_fix,\"too few matches, 3 of 12\",,,,,,,,,,,,,,,0,0,,5.000,1");
  EXPECT_NE(lines[3].find(",0.000000,0.000000,0.000000,"), std::string::npos) << "heading 360";
}

TEST(PosesCsv, RoundTrip) {
  const TempFolder folder;
  const auto rows = SampleRows();
  WriteText(folder / "poses.csv", FormatPoses(rows, PoseFormat::kCsv));
  const auto read = ReadPosesCsv(folder / "poses.csv");
  ASSERT_TRUE(read.ok()) << read.status().message();
  ASSERT_EQ(read->size(), rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const PoseRow &a = rows[i], &b = (*read)[i];
    EXPECT_EQ(a.timestamp_ns, b.timestamp_ns);
    EXPECT_EQ(a.status, b.status);
    EXPECT_EQ(a.reason, b.reason);
    EXPECT_EQ(a.best_panorama, b.best_panorama);
    EXPECT_EQ(a.num_inliers, b.num_inliers);
    EXPECT_EQ(a.num_views, b.num_views);
    EXPECT_EQ(a.map_is_unsigned, b.map_is_unsigned);
    EXPECT_NEAR(a.latency_ms, b.latency_ms, 0.51e-3);
    ASSERT_EQ(a.pose.has_value(), b.pose.has_value());
    if (!a.pose) continue;
    EXPECT_NEAR(a.pose->position.lat_deg, b.pose->position.lat_deg, kDegreeTolerance);
    EXPECT_NEAR(a.pose->position.lon_deg, b.pose->position.lon_deg, kDegreeTolerance);
    EXPECT_NEAR(a.pose->position.height_m, b.pose->position.height_m, kHeightToleranceM);
    EXPECT_NEAR(AngleDifferenceDeg(a.pose->attitude.heading_deg, b.pose->attitude.heading_deg), 0,
                kAngleTolerance);
    EXPECT_NEAR(a.pose->attitude.pitch_deg, b.pose->attitude.pitch_deg, kAngleTolerance);
    EXPECT_NEAR(a.pose->attitude.roll_deg, b.pose->attitude.roll_deg, kAngleTolerance);
    EXPECT_LT((a.pose->enu_from_cam.coeffs() - b.pose->enu_from_cam.coeffs()).cwiseAbs().maxCoeff(),
              kQuaternionTolerance);
    EXPECT_NEAR(a.pose->sigma_up_m, b.pose->sigma_up_m, kSigmaTolerance);
    EXPECT_NEAR(a.pose->sigma_heading_deg, b.pose->sigma_heading_deg, kSigmaTolerance);
  }
}

TEST(PosesCsv, PiecesMakeTheWhole) {
  const auto rows = SampleRows();
  std::string text = PosesCsvHeader();
  for (const PoseRow& row : rows) text += PosesCsvRow(row);
  EXPECT_EQ(text, FormatPoses(rows, PoseFormat::kCsv));
}

TEST(PosesCsv, FaultsNameTheLine) {
  const TempFolder folder;
  const std::string good = FormatPoses(SampleRows(), PoseFormat::kCsv);
  const auto expect = [&](const std::string& from, const std::string& to, const std::string& part) {
    std::string text = good;
    const auto at = text.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    WriteText(folder / "p.csv", text.replace(at, from.size(), to));
    const Status fault = ReadPosesCsv(folder / "p.csv").status();
    EXPECT_EQ(fault.code(), ErrorCode::kBadData);
    EXPECT_NE(fault.message().find(part), std::string::npos) << fault.message();
  };
  expect(",no_fix,", ",lost,", "p.csv:3: status 'lost' is unknown");
  expect(",no_fix,", ",fix,", "p.csv:3: latitude '' is not a finite number");
  expect(",fix,", ",no_fix,", "p.csv:2: a row of status no_fix holds a pose");
  expect("48.8505986676", "148.85", "p.csv:2: latitude '148.85' lies outside");
  expect(",120,4,", ",120.5,4,", "num_inliers '120.5' is not an integer");
  expect(",120,4,", ",-1,4,", "num_inliers '-1' lies outside");
  expect(",0.3000,", ",-0.3,", "sigma_up_m '-0.3' lies outside");
  expect("qw,", "qq,", "column 'qw' is missing");
  EXPECT_EQ(ReadPosesCsv(folder / "absent.csv").status().code(), ErrorCode::kNotFound);
}

TEST(PosesCsv, QuaternionOfWrongLengthIsRefused) {
  const TempFolder folder;
  auto rows = SampleRows();
  rows[0].pose->enu_from_cam.coeffs() *= 0.9;
  WriteText(folder / "p.csv", FormatPoses(rows, PoseFormat::kCsv));
  EXPECT_EQ(ReadPosesCsv(folder / "p.csv").status().code(), ErrorCode::kBadData);
}

TEST(PosesTum, LocalMetresOfTheFirstPose) {
  // One degree of latitude and of longitude near the equator, closed form of the ellipsoid:
  // meridian radius a (1 - e2) = 6335439.327 m, equatorial radius 6378137 m.
  constexpr double kStepDeg = 1e-4;
  constexpr double kNorthM = 6335439.327 * kStepDeg * kRadPerDeg;
  constexpr double kEastM = 6378137.0 * kStepDeg * kRadPerDeg;
  constexpr double kToleranceM = 2e-4;  // four decimals; the arc's sagitta here is 1e-5 m
  const std::vector<PoseRow> rows{Fix(1'500'000'000, {0, 10, 100}, {0, 0, 0}), NoFix(2'000'000'000),
                                  Fix(2'000'000'007, {kStepDeg, 10 + kStepDeg, 105}, {90, 0, 0})};
  const auto lines = Lines(FormatPoses(rows, PoseFormat::kTum));
  ASSERT_EQ(lines.size(), 3U);
  EXPECT_EQ(lines[0][0], '#');
  EXPECT_NE(lines[0].find("10.0000000000"), std::string::npos);
  EXPECT_EQ(lines[1].rfind("1.500000000 0.0000 0.0000 0.0000 ", 0), 0U) << lines[1];
  EXPECT_EQ(lines[2].rfind("2.000000007 ", 0), 0U) << lines[2];
  std::istringstream in(lines[2]);
  double t, x, y, z, qx, qy, qz, qw;
  ASSERT_TRUE(in >> t >> x >> y >> z >> qx >> qy >> qz >> qw);
  EXPECT_NEAR(x, kEastM, kToleranceM);
  EXPECT_NEAR(y, kNorthM, kToleranceM);
  EXPECT_NEAR(z, 5, kToleranceM);
  // Heading east: the optical axis points along +x of the first frame.
  const Eigen::Vector3d axis = Eigen::Quaterniond(qw, qx, qy, qz) * Eigen::Vector3d::UnitZ();
  EXPECT_NEAR(axis.x(), 1, 1e-6);
}

TEST(PosesGeoJson, ParsesAndHoldsThePoses) {
  auto rows = SampleRows();
  rows[0].best_panorama = "quote \" back \\ tab \t line \n";
  const auto json = nlohmann::json::parse(FormatPoses(rows, PoseFormat::kGeoJson));
  EXPECT_EQ(json["type"], "FeatureCollection");
  ASSERT_EQ(json["features"].size(), 3U);
  const auto& first = json["features"][0];
  EXPECT_EQ(first["geometry"]["type"], "Point");
  EXPECT_NEAR(first["geometry"]["coordinates"][0].get<double>(), 2.33481427631, kDegreeTolerance);
  EXPECT_NEAR(first["geometry"]["coordinates"][1].get<double>(), 48.85059866764, kDegreeTolerance);
  EXPECT_EQ(first["properties"]["timestamp_ns"].get<std::int64_t>(), 1402922358641000001);
  EXPECT_EQ(first["properties"]["best_panorama"], rows[0].best_panorama);
  EXPECT_EQ(json["features"][1]["properties"]["status"], "degraded");
  EXPECT_EQ(nlohmann::json::parse(FormatPoses({}, PoseFormat::kGeoJson))["features"].size(), 0U);
}

TEST(PosesGpx, SegmentsBreakAtGapsAndTimesAreUtc) {
  const std::string text = FormatPoses(SampleRows(), PoseFormat::kGpx);
  const auto count = [&](const std::string& part) {
    int found = 0;
    for (auto at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++found;
    return found;
  };
  EXPECT_EQ(count("<trkpt "), 3);
  EXPECT_EQ(count("</trkpt>"), 3);
  EXPECT_EQ(count("<trkseg>"), 2);
  EXPECT_EQ(count("</trkseg>"), 2);
  EXPECT_EQ(count("<time>2014-06-16T12:39:18.641000001Z</time>"), 1);
  EXPECT_EQ(count("<time>1969-12-31T23:59:59.999999999Z</time>"), 1);
  EXPECT_EQ(count("</gpx>\n"), 1);
}

TEST(PosesFormats, EmptyAndUnknown) {
  EXPECT_EQ(FormatPoses({}, PoseFormat::kCsv), PosesCsvHeader());
  EXPECT_EQ(FormatPoses({}, PoseFormat::kTum), "");
  EXPECT_EQ(FormatPoses({NoFix(1)}, PoseFormat::kGpx).find("<trkseg>"), std::string::npos);
  EXPECT_EQ(*ParsePoseFormat("tum"), PoseFormat::kTum);
  const auto unknown = ParsePoseFormat("kml");
  EXPECT_EQ(unknown.status().code(), ErrorCode::kInvalidArgument);
  EXPECT_NE(unknown.status().message().find("choose csv, tum, geojson or gpx"), std::string::npos);
}

}  // namespace
}  // namespace panofix
