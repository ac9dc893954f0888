// Real payloads against values computed from the contract by code that shares nothing with this
// one.

#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "builder/ingest/depth_map.h"

namespace panofix {
namespace {

constexpr double kRangeTolerance_m = 6e-5;  // the table has four decimals
constexpr double kShareTolerance = 6e-7;    // and six

std::vector<std::string> Fields(const std::string& line) {
  std::vector<std::string> fields;
  std::stringstream stream(line);
  for (std::string field; std::getline(stream, field, ',');) fields.push_back(field);
  fields.resize(12);  // trailing empty fields
  return fields;
}

TEST(DepthMap, AgreesWithTheTableOfRealPayloads) {
  const std::filesystem::path folder = std::filesystem::path(PANOFIX_EVALUATION_DATA) / "gsv_depth";
  std::ifstream table(folder / "expected.csv");
  if (!table) GTEST_SKIP() << "no evaluation data at " << folder << "; set PANOFIX_EVALUATION_DATA";
  std::string line;
  std::getline(table, line);
  const std::pair<int, int> pixels[] = {{256, 150}, {384, 120}, {128, 120}, {10, 170}, {300, 230}};
  int num_rows = 0;
  while (std::getline(table, line)) {
    const std::vector<std::string> fields = Fields(line);
    SCOPED_TRACE(fields[0]);
    const auto map = DepthMap::Read(folder / (fields[0] + ".gsv"), 0.001);
    ASSERT_TRUE(map.ok()) << map.status().message();
    EXPECT_EQ(map->is_zlib() ? "zlib" : "raw", fields[1]);
    EXPECT_EQ(map->planes().size(), std::stoul(fields[2]));
    const auto ground = map->GroundPlane();
    ASSERT_TRUE(ground);
    EXPECT_EQ(*ground, std::stoi(fields[3]));
    EXPECT_NEAR(map->planes()[static_cast<std::size_t>(*ground)].d_m, std::stod(fields[4]),
                kRangeTolerance_m);
    EXPECT_NEAR(map->SurfaceShare(), std::stod(fields[5]), kShareTolerance);
    EXPECT_EQ(map->is_placeholder(), fields[6] == "1");
    for (std::size_t i = 0; i < 5; ++i) {
      const auto hit = map->CastPixel(pixels[i].first, pixels[i].second);
      ASSERT_EQ(hit.has_value(), !fields[7 + i].empty()) << i;
      if (hit) {
        EXPECT_NEAR(hit->range_m, std::stod(fields[7 + i]), kRangeTolerance_m);
      }
    }
    ++num_rows;
  }
  EXPECT_EQ(num_rows, 46);
}

}  // namespace
}  // namespace panofix
