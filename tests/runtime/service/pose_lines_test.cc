#include "runtime/service/pose_lines.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "runtime/localizer/localizer.h"
#include "tests/runtime/service/service_support.h"

namespace panofix {
namespace {

using namespace service_test;
using testing::HasSubstr;
using testing::StartsWith;

PoseRow RowAt(double lat_deg, double lon_deg) {
  PoseRow row = ToPoseRow(SampleFix(1'700'000'000'120'000'000));  // 22:13:20.12
  row.pose->position = {lat_deg, lon_deg, 94.25};
  return row;
}

TEST(PoseLines, NmeaOfAFix) {
  const std::string text = ToNmea(RowAt(48.5, -2.25));
  EXPECT_THAT(text, StartsWith("$GPGGA,221320.12,4830.0000000,N,00215.0000000,W,1,,,94.250,M,"
                               "0.0,M,,*"));
  EXPECT_THAT(text, HasSubstr("\r\n$GPHDT,123.50,T*"));
  EXPECT_THAT(text, HasSubstr("\r\n$GPGST,221320.12,,,,,"));
}

// A textbook sentence's checksum, and a sum over our own.
TEST(PoseLines, ChecksumsAreRight) {
  std::size_t num_sentences = 0;
  const std::string text = ToNmea(RowAt(-33.9, 151.2)) + ToNmea(ToPoseRow(SampleNoFix(5)));
  for (std::size_t at = 0; (at = text.find('$', at)) != std::string::npos; ++num_sentences) {
    const std::size_t star = text.find('*', at);
    unsigned sum = 0;
    for (std::size_t i = at + 1; i < star; ++i) sum ^= static_cast<unsigned char>(text[i]);
    EXPECT_EQ(std::stoul(text.substr(star + 1, 2), nullptr, 16), sum);
    EXPECT_EQ(text.substr(star + 3, 2), "\r\n");
    at = star;
  }
  EXPECT_EQ(num_sentences, 4U);
}

TEST(PoseLines, MinutesNeverReachSixty) {
  const std::string text = ToNmea(RowAt(48.9999999999999, 179.9999999999999));
  EXPECT_THAT(text, HasSubstr(",4900.0000000,N,18000.0000000,E,"));
}

TEST(PoseLines, NoFixSaysSo) {
  const PoseRow row = ToPoseRow(SampleNoFix(1'700'000'000'120'000'000));
  EXPECT_THAT(ToNmea(row), StartsWith("$GPGGA,221320.12,,,,,0,"));
  const auto json = nlohmann::json::parse(ToGeoJsonLine(row));
  EXPECT_TRUE(json["geometry"].is_null());
  EXPECT_EQ(json["properties"]["reason"], "too_few_inliers");
}

TEST(PoseLines, GeoJsonIsOneLineLongitudeFirst) {
  const std::string line = ToGeoJsonLine(RowAt(48.5, -2.25));
  EXPECT_EQ(line.find('\n'), line.size() - 1);
  const auto json = nlohmann::json::parse(line);
  EXPECT_EQ(json["geometry"]["coordinates"], nlohmann::json::parse("[-2.25,48.5,94.25]"));
  EXPECT_EQ(json["properties"]["timestamp_ns"], 1'700'000'000'120'000'000);
}

}  // namespace
}  // namespace panofix
