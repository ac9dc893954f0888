#include "builder/pipeline/build_plan.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>

#include "tests/common/features/synthetic_image.h"
#include "tests/common/io/temp_folder.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

// Every option as a number that is not its default.
BuildOptions OddOptions() {
  BuildOptions o;
  Json j = Json::parse(FormatOptions(o));
  int i = 0;
  for (auto& [name, value] : j.items()) {
    ++i;
    if (name == "equalization")
      value = "global";
    else if (value.is_boolean())
      value = !value.get<bool>();
    else if (value.is_number_float())
      value = value.get<double>() + 0.1 * i;
    else if (value.is_number())
      value = value.get<int>() + i;
    else if (value.is_array())
      value = {0.1, -1.8};
    else
      value = value.get<std::string>() + "x";
  }
  return ParseOptions(j.dump());
}

TEST(BuildOptions, SurviveTheirJson) {
  const std::string json = FormatOptions(OddOptions());
  EXPECT_EQ(FormatOptions(ParseOptions(json)), json);
  const Json odd = Json::parse(json), plain = Json::parse(FormatOptions(BuildOptions{}));
  for (const auto& [name, value] : plain.items()) EXPECT_NE(odd[name], value) << name;
}

TEST(BuildOptions, MissingAndUnknownOnesAreErrors) {
  Json j = Json::parse(FormatOptions(BuildOptions{}));
  Json more = j;
  more["zeal"] = 1;
  EXPECT_THROW((void)ParseOptions(more.dump()), Error);
  j.erase("seed");
  EXPECT_THROW((void)ParseOptions(j.dump()), Error);
  EXPECT_THROW((void)ParseOptions("[]"), Error);
  EXPECT_THROW((void)ParseOptions("{"), Error);
}

class PlanTest : public testing::Test {
 protected:
  PlanTest() {
    const GrayImage image = BusyImage(64, 32, 1);
    const cv::Mat view(image.height_px, image.width_px, CV_8UC1,
                       const_cast<std::uint8_t*>(image.pixels.data()));
    EXPECT_TRUE(cv::imwrite((folder_ / "p.png").string(), view));
    WriteText(folder_ / "camera.yaml",
              ToCameraYaml(Camera::FromHorizontalFov(120, 90, 80), "test"));
    // Two groups of three, some 3 km apart.
    for (int i = 0; i < 6; ++i) Add("p" + std::to_string(i), i * 1e-4 + (i < 3 ? 0 : 0.03));
    options_.panoramas = folder_ / "set.geojsonl";
    options_.camera = folder_ / "camera.yaml";
    options_.out = folder_ / "map";
    options_.work = folder_ / "work";
  }
  void Add(const std::string& id, double north_deg, const std::string& image = "p.png") {
    lines_.push_back(
        {{"type", "Feature"},
         {"id", id},
         {"geometry", {{"type", "Point"}, {"coordinates", {2.3, 48.85 + north_deg, 35}}}},
         {"properties", {{"image", image}, {"heading", 359.99999999999994}}}});
  }
  BuildPlan Plan() {
    std::string text;
    for (const Json& line : lines_) text += line.dump() + "\n";
    WriteText(options_.panoramas, text);
    return MakePlan(options_);
  }
  TempFolder folder_;
  std::vector<Json> lines_;
  BuildOptions options_;
};

TEST_F(PlanTest, ShardsAndTilesHoldEveryPanoramaOnce) {
  const BuildPlan plan = Plan();
  EXPECT_EQ(plan.num_stated, 6);
  EXPECT_EQ(plan.options.name, "map");
  std::int64_t in_shards = 0, in_tiles = 0;
  std::set<std::string> ids;
  for (const auto& [shard, content] : plan.shards) {
    in_shards += content.num_panoramas;
    for (const PanoramaRecord& r : ReadRecords(WorkFolder(options_.work), plan, shard)) {
      ids.insert(r.id);
      EXPECT_EQ(r.image, folder_ / "p.png");
      EXPECT_EQ(r.attitude.heading_deg, 359.99999999999994);
    }
    EXPECT_TRUE(content.halo.empty());
  }
  for (const auto& [tile, content] : plan.tiles) in_tiles += content.num_panoramas;
  EXPECT_GE(plan.shards.size(), 2U);
  EXPECT_EQ(in_shards, 6);
  EXPECT_EQ(in_tiles, 6);
  EXPECT_EQ(ids.size(), 6U);
}

TEST_F(PlanTest, IsReadAsItWasWritten) {
  const BuildPlan plan = Plan(), read = ReadPlan(WorkFolder(options_.work));
  EXPECT_EQ(FormatOptions(read.options), FormatOptions(plan.options));
  EXPECT_EQ(read.options.out, fs::absolute(folder_ / "map"));
  EXPECT_EQ(read.num_stated, plan.num_stated);
  ASSERT_EQ(read.shards.size(), plan.shards.size());
  for (const auto& [shard, content] : plan.shards) {
    EXPECT_EQ(read.shards.at(shard).records_sha256, content.records_sha256);
    EXPECT_EQ(read.shards.at(shard).halo, content.halo);
  }
  ASSERT_EQ(read.tiles.size(), plan.tiles.size());
  for (const auto& [tile, content] : plan.tiles)
    EXPECT_EQ(read.tiles.at(tile).shards, content.shards);
}

// Engines look at times: what did not change must not look new.
TEST_F(PlanTest, ASecondPlanOfTheSameTouchesNothing) {
  const BuildPlan plan = Plan();
  const WorkFolder work(options_.work);
  std::map<fs::path, fs::file_time_type> before;
  for (const auto& entry : fs::recursive_directory_iterator(work.root())) {
    fs::last_write_time(entry.path(), fs::file_time_type::clock::now() - std::chrono::hours(1));
    before[entry.path()] = fs::last_write_time(entry.path());
  }
  std::reverse(lines_.begin(), lines_.end());
  (void)Plan();
  for (const auto& [path, time] : before) EXPECT_EQ(fs::last_write_time(path), time) << path;
  // Another panorama changes its own shard's records alone.
  Add("p9", 0.0302);
  (void)Plan();
  int num_changed = 0;
  for (const auto& [shard, unused] : plan.shards) {
    const fs::path records = work.records(shard);
    num_changed += fs::last_write_time(records) != before[records] ? 1 : 0;
  }
  EXPECT_EQ(num_changed, 1);
}

TEST_F(PlanTest, ALinkAcrossABorderMakesAHalo) {
  lines_[0]["properties"]["links"] = {"p5"};
  const BuildPlan plan = Plan();
  for (const auto& [shard, content] : plan.shards) EXPECT_EQ(content.halo.size(), 1U);
  for (const auto& [tile, content] : plan.tiles) EXPECT_EQ(content.shards.size(), 2U);
}

TEST_F(PlanTest, BadPanoramasAreListedAndAFewDoNotStopAPlan) {
  options_.max_set_aside_share = 0.2;
  Add("bad", 0.031, "none.png");
  const BuildPlan plan = Plan();
  ASSERT_EQ(plan.set_aside.size(), 1U);
  EXPECT_EQ(plan.set_aside[0].id, "bad");
  EXPECT_EQ(plan.num_panoramas(), 6);
}

TEST_F(PlanTest, TooManyBadOnesStopItBeforeAnythingIsDecoded) {
  options_.max_set_aside_share = 0.2;
  for (int i = 0; i < 3; ++i) Add("bad" + std::to_string(i), 0.031, "none.png");
  try {
    (void)Plan();
    ADD_FAILURE() << "nothing was thrown";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::kBadData);
    EXPECT_NE(std::string(error.what()).find("3 of 9"), std::string::npos) << error.what();
  }
  EXPECT_FALSE(fs::exists(WorkFolder(options_.work).plan()));
  const Json report = Json::parse(ReadText(folder_ / "map.report.json"));
  EXPECT_EQ(report["set_aside"].size(), 3U);
}

TEST_F(PlanTest, ShardsTogetherMayBeTooMuch) {
  const BuildPlan plan = Plan();  // half of six may be bad
  const std::vector<SetAside> one = {{"a", "broken"}};
  EXPECT_NO_THROW(RefuseTooManySetAside(plan, one, 2));
  EXPECT_THROW(RefuseTooManySetAside(plan, one, 3), Error);
  EXPECT_NO_THROW(RefuseTooManySetAside(plan, {}, 0));
}

TEST_F(PlanTest, LeftoversOfYesterdayGo) {
  (void)Plan();
  const WorkFolder work(options_.work);
  const auto make = [&](const fs::path& path, int hours_old) {
    WriteText(path, "x");
    const auto time = fs::file_time_type::clock::now() - std::chrono::hours(hours_old);
    fs::last_write_time(path, time);
    fs::last_write_time(path.parent_path(), time);
  };
  make(work.root() / "words" / ".k.h5.1-ab.tmp", 30);
  make(work.root() / "tiles" / ".k.h5.1-ab.tmp", 1);
  make(work.root() / "tiles" / "k.h5", 30);
  make(folder_ / "map.staging-1-ab" / "graph.h5", 30);
  make(folder_ / "map.staging-2-ab" / "graph.h5", 1);
  make(folder_ / "other.staging-1-ab" / "graph.h5", 30);
  RemoveStale(work, options_.out);
  EXPECT_FALSE(fs::exists(work.root() / "words" / ".k.h5.1-ab.tmp"));
  EXPECT_TRUE(fs::exists(work.root() / "tiles" / ".k.h5.1-ab.tmp"));
  EXPECT_TRUE(fs::exists(work.root() / "tiles" / "k.h5"));
  EXPECT_FALSE(fs::exists(folder_ / "map.staging-1-ab"));
  EXPECT_TRUE(fs::exists(folder_ / "map.staging-2-ab"));
  EXPECT_TRUE(fs::exists(folder_ / "other.staging-1-ab"));
}

TEST_F(PlanTest, ADamagedPlanAndForeignRecordsAreSaid) {
  const BuildPlan plan = Plan();
  const WorkFolder work(options_.work);
  WriteText(work.records(plan.shards.begin()->first), "{}\n");
  EXPECT_THROW((void)ReadRecords(work, plan, plan.shards.begin()->first), Error);
  EXPECT_THROW((void)ReadRecords(work, plan, "31"), Error);
  for (const char* text : {"", "{", "{}", "[1]"}) {
    WriteText(work.plan(), text);
    EXPECT_THROW((void)ReadPlan(work), Error) << text;
  }
  EXPECT_THROW((void)ReadPlan(WorkFolder(folder_ / "nowhere")), Error);
}

TEST_F(PlanTest, WhatIsNoReleaseIsRefused) {
  options_.vocabulary = folder_ / "p.png";
  EXPECT_THROW((void)Plan(), Error);
  options_.vocabulary = folder_ / "none.h5";
  EXPECT_THROW((void)Plan(), Error);
}

}  // namespace
}  // namespace panofix
