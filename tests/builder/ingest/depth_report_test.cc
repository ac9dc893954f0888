#include "builder/ingest/depth_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/builder/ingest/gsv_writer.h"

namespace panofix {
namespace {

using nlohmann::json;
using testing::HasSubstr;

// Ground 2.5 m below in the lower half, one more plane that no pixel names.
DepthMap Scene(std::size_t num_planes = 3) {
  std::vector<TestPlane> planes = {{}, {0, 0, -1, 2.5F}, {0, 1, 0, 4}};
  planes.resize(num_planes);
  std::vector<std::uint8_t> plane_idx(16 * 8, 0);
  std::fill(plane_idx.begin() + 64, plane_idx.end(), std::uint8_t{1});
  return DepthMap::DecodeGsv(Base64(GsvPayload(16, 8, planes, plane_idx))).value();
}

TEST(DepthReport, JsonHasEveryKey) {
  const std::vector<DepthPixel> pixels = {{8, 7}, {3, 0}};
  const json report = json::parse(DepthReportJson(Scene(), "a.gsv", pixels));
  EXPECT_EQ(report["file"], "a.gsv");
  EXPECT_EQ(report["encoding"], "raw");
  EXPECT_EQ(report["width"], 16);
  EXPECT_EQ(report["height"], 8);
  EXPECT_EQ(report["planes"], 3);
  EXPECT_EQ(report["placeholder"], false);
  EXPECT_EQ(report["surface_share"], 0.5);
  EXPECT_EQ(report["ground_plane"], 1);
  EXPECT_EQ(report["ground_d_m"], 2.5);
  EXPECT_EQ(report["ground_normal"], json({0.0, 0.0, -1.0}));
  ASSERT_EQ(report["pixels"].size(), 2U);
  const json& hit = report["pixels"][0];
  EXPECT_EQ(hit["col"], 8);
  EXPECT_EQ(hit["row"], 7);
  EXPECT_EQ(hit["plane"], 1);
  // 2.5 / sin(78.75 degrees), the elevation of the last row.
  EXPECT_NEAR(hit["range_m"].get<double>(), 2.548978, 1e-6);
  EXPECT_EQ(hit["normal"][2].get<double>(), 1.0);
  const json& miss = report["pixels"][1];
  EXPECT_TRUE(miss["range_m"].is_null() && miss["normal"].is_null());
  EXPECT_EQ(miss["plane"], 0);
}

TEST(DepthReport, TextSaysTheSame) {
  const std::vector<DepthPixel> pixels = {{8, 7}, {3, 0}};
  const std::string text = DepthReportText(Scene(), "a.gsv", pixels);
  EXPECT_THAT(text, HasSubstr("a.gsv: raw, 16x8, 3 planes"));
  EXPECT_THAT(text, HasSubstr("surface: 50.0 %"));
  EXPECT_THAT(text, HasSubstr("ground: plane 1, d 2.5000 m"));
  EXPECT_THAT(text, HasSubstr("pixel 8,7: 2.5490 m, plane 1"));
  EXPECT_THAT(text, HasSubstr("pixel 3,0: no surface"));
  EXPECT_EQ(text.find("placeholder"), std::string::npos);
}

TEST(DepthReport, PlaceholdersAreSaidToBe) {
  EXPECT_THAT(DepthReportText(Scene(2), "a.gsv", {}), HasSubstr("placeholder"));
  EXPECT_EQ(json::parse(DepthReportJson(Scene(2), "a.gsv", {}))["placeholder"], true);
}

TEST(DepthReport, NamesThatAreNoUtf8DoNotThrow) {
  EXPECT_EQ(json::parse(DepthReportJson(Scene(), "\xFF.gsv", {}))["file"], "\xEF\xBF\xBD.gsv");
}

TEST(ParseDepthPixel, TakesWholeNumbersInsideTheMap) {
  const DepthMap map = Scene();
  const auto pixel = ParseDepthPixel("15,7", map);
  ASSERT_TRUE(pixel.ok());
  EXPECT_EQ(pixel->column, 15);
  EXPECT_EQ(pixel->row, 7);
  for (const char* text :
       {"", "3", "3,", ",3", "3,4,5", "3.5,4", "3 4", "a,b", " 3,4", "3,4 ", "99999999999,1"}) {
    EXPECT_THAT(ParseDepthPixel(text, map).status().message(), HasSubstr("COL,ROW")) << text;
  }
  for (const char* text : {"16,0", "0,8", "-1,0", "0,-1"}) {
    EXPECT_THAT(ParseDepthPixel(text, map).status().message(), HasSubstr("columns are 0..15"))
        << text;
  }
}

}  // namespace
}  // namespace panofix
