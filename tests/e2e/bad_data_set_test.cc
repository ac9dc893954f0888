// Panoramas, depth files and cameras that break their rules, through panofix-builder build.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/builder/ingest/gsv_writer.h"
#include "tests/e2e/bad_input.h"

namespace panofix::e2e {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

constexpr std::size_t kNum = kNumBadInputPanoramas;

class BadDataSet : public testing::Test {
 protected:
  BadDataSet() : set_(ReadJson(data_.panoramas())) {}

  Json& feature(std::size_t i) { return set_["features"][i]; }
  Json& properties(std::size_t i) { return feature(i)["properties"]; }
  // A copy of a good feature, added under its own id.
  Json& Add(const std::string& id) {
    Json copy = set_["features"][0];
    copy["id"] = id;
    copy["properties"]["links"] = Json::array();
    set_["features"].push_back(copy);
    return set_["features"].back();
  }
  [[nodiscard]] fs::path out() const { return data_.root() / TestName(); }
  [[nodiscard]] fs::path WriteSet() const {
    return WriteDataSet(data_, TestName() + ".geojson", set_);
  }
  [[nodiscard]] Outcome Build(const std::vector<std::string>& options = {}) const {
    return data_.Build(WriteSet(), out(), options);
  }
  // A part of the report of the last build: reasons by id.
  [[nodiscard]] std::map<std::string, std::string> Reported(const std::string& part) const {
    std::map<std::string, std::string> reasons;
    const Json report = ReadJson(out().string() + ".report.json");
    for (const Json& entry : report[part]) reasons[entry["id"]] = entry["reason"];
    return reasons;
  }
  [[nodiscard]] Json Counts() const { return ReadJson(out() / "manifest.json")["counts"]; }
  // A damaged copy of a panorama's image; its path from the data set.
  [[nodiscard]] std::string CutImage(double share) const {
    const std::string name = "panoramas/" + TestName() + ".jpg";
    fs::copy_file(data_.town() / "panoramas" / "pano-00000.jpg", data_.town() / name,
                  fs::copy_options::overwrite_existing);
    TruncateFile(data_.town() / name, share);
    return name;
  }
  static std::string TestName() {
    return testing::UnitTest::GetInstance()->current_test_info()->name();
  }

  const TownData& data_ = SharedData().data;
  Json set_;
};

TEST_F(BadDataSet, AFewBadPanoramasAreSetAsideAndCounted) {
  properties(1)["image"] = "panoramas/nowhere.jpg";
  properties(3)["image"] = CutImage(0.6);
  const Outcome outcome = Build();
  ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  const auto reasons = Reported("set_aside");
  ASSERT_EQ(reasons.size(), 2U);
  EXPECT_THAT(reasons.at("pano-00001"), HasSubstr("nowhere.jpg: no such file; check the path"));
  EXPECT_THAT(reasons.at("pano-00003"), HasSubstr(TestName() + ".jpg: "));
  EXPECT_EQ(Counts()["panoramas"], kNum - 2);
  EXPECT_EQ(Counts()["set_aside"], 2);
  EXPECT_THAT(outcome.output, HasSubstr("set aside: 2"));
  // What is left works.
  EXPECT_EQ(data_.Localize(out(), data_.drive(), out().string() + ".csv").exit_code, 0);
}

TEST_F(BadDataSet, EveryFaultOfAPanoramaIsNamed) {
  const std::string image = properties(0)["image"];
  const std::vector<std::string> good{"pano-00000", "pano-00001", "pano-00002", "pano-00003",
                                      "pano-00004"};
  Add("cut-in-header")["properties"]["image"] = CutImage(0.0001);
  Add("not-equirectangular")["properties"]["image"] = "drive/images/000000.jpg";
  Add("not-an-image")["properties"]["image"] = "camera.yaml";
  Add("a-folder")["properties"]["image"] = "panoramas";
  Add("no-image")["properties"].erase("image");
  Add("no-mask")["properties"]["mask"] = "masks/nowhere.png";
  Add("twice"), Add("twice");
  Add("north-of-north")["geometry"]["coordinates"][1] = 91;
  Add("far-east")["geometry"]["coordinates"][0] = 181;
  Add("no-height")["geometry"]["coordinates"].erase(2);
  Add("no-heading")["properties"]["heading"] = "north";
  Add("bad-links")["properties"]["links"] = "pano-00001";
  Add("nameless").erase("id");  // the 19th
  const Outcome outcome = Build({"--max-set-aside-share", "0.9"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  EXPECT_EQ(Counts()["panoramas"], kNum);
  const auto reasons = Reported("set_aside");
  const std::map<std::string, std::vector<std::string>> expected{
      {"cut-in-header", {TestName() + ".jpg"}},
      {"not-equirectangular", {"000000.jpg", "240x180", "width must be twice the height"}},
      {"not-an-image", {"camera.yaml", "JPEG"}},
      {"a-folder", {"panoramas", "check the path"}},
      {"no-image", {"no image", "give"}},
      {"no-mask", {"masks/nowhere.png", "no such file", "check the path"}},
      {"twice", {"more than once", "its own"}},
      {"north-of-north", {"latitude is 91", "give a Point"}},
      {"far-east", {"longitude is 181", "give a Point"}},
      {"no-height", {"no height", "give a Point"}},
      {"no-heading", {"heading is not a number", "clockwise from true north"}},
      {"bad-links", {"links", "give the neighbours' ids"}},
      {"feature 19", {"no id", "unique"}}};
  EXPECT_EQ(reasons.size(), expected.size());
  for (const auto& [id, words] : expected) {
    ASSERT_TRUE(reasons.contains(id)) << id;
    for (const std::string& word : words) EXPECT_THAT(reasons.at(id), HasSubstr(word));
    EXPECT_EQ(reasons.at(id).find('\n'), std::string::npos);
  }
  // The good ones are as if the others had never been there.
  EXPECT_EQ(ReadText(out() / "graph.h5"), ReadText(SharedData().bundle / "graph.h5"));
}

TEST_F(BadDataSet, NumbersThatAreNotFiniteAreSetAside) {
  const fs::path path = WriteSet();
  ReplaceInFile(path, "\"pitch\": ", "\"pitch\": NaN, \"was\": ");
  const Outcome outcome = data_.Build(path, out());
  ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  const auto reasons = Reported("set_aside");
  ASSERT_EQ(reasons.size(), 1U);
  EXPECT_THAT(reasons.at("feature 1"), HasSubstr("not finite; write a finite number"));
}

TEST_F(BadDataSet, MoreThanHalfBadFailsTheBuild) {
  for (const std::size_t i : {0U, 2U, 4U}) properties(i)["image"] = "panoramas/nowhere.jpg";
  ExpectRefused(
      Build(), kBadData,
      {TestName() + ".geojson", "3 of 5", "pano-00000", "nowhere.jpg", "--max-set-aside-share"});
  EXPECT_FALSE(fs::exists(out()));
}

TEST_F(BadDataSet, AFailedBuildLeavesTheEarlierBundle) {
  CopyFolder(SharedData().bundle, out());
  for (std::size_t i = 0; i < kNum; ++i) properties(i)["image"] = "panoramas/nowhere.jpg";
  EXPECT_EQ(Build().exit_code, kBadData);
  EXPECT_EQ(Builder({"inspect", out().string()}).exit_code, 0);
}

TEST_F(BadDataSet, DepthThatCannotBeUsedLeavesThePanorama) {
  const auto write = [&](const std::string& name, const std::vector<std::uint8_t>& payload) {
    WriteText(data_.town() / "panoramas" / name, Base64(payload));
    return "panoramas/" + name;
  };
  const std::vector<TestPlane> three{{}, {0, 0, -1, 2.5F}, {0, 1, 0, 8}};
  properties(0)["depth"] =
      write("flat.gsv", GsvPayload(200, 150, three, std::vector<std::uint8_t>(200 * 150, 1)));
  properties(1)["depth"] = "panoramas/nowhere.gsv";
  properties(2)["depth"] = nullptr;
  properties(3)["depth"] = write("stub.gsv", GsvPayload(512, 256, {{}, {0, 0, -1, 2.5F}},
                                                        std::vector<std::uint8_t>(512 * 256, 1)));
  // Smaller than usual but in order: every size that is 2:1 serves.
  properties(4)["depth"] =
      write("small.gsv", GsvPayload(256, 128, three, std::vector<std::uint8_t>(256 * 128, 1)));
  const Outcome outcome = Build();
  ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  EXPECT_EQ(Counts()["panoramas"], kNum);
  EXPECT_EQ(Counts()["set_aside"], 0);
  const auto reasons = Reported("without_depth");
  ASSERT_EQ(reasons.size(), 4U);
  EXPECT_THAT(reasons.at("pano-00000"), HasSubstr("flat.gsv: depth is 200x150"));
  EXPECT_THAT(reasons.at("pano-00001"), HasSubstr("nowhere.gsv: no such file"));
  EXPECT_THAT(reasons.at("pano-00002"), HasSubstr("no depth file"));
  EXPECT_THAT(reasons.at("pano-00003"), HasSubstr("stub.gsv: a placeholder"));
  const Json inspected = Json::parse(Builder({"inspect", out().string(), "--json"}).output);
  EXPECT_EQ(inspected["coverage"]["panoramas_with_depth"], 1);
  EXPECT_EQ(data_.Localize(out(), data_.drive(), out().string() + ".csv").exit_code, 0);
}

TEST_F(BadDataSet, AFileWithoutPanoramasIsRefused) {
  set_["features"] = Json::array();
  ExpectRefused(Build(), kBadData, {TestName() + ".geojson", "no panorama", "at least one"});
  const fs::path path = data_.town() / "strange.geojson";
  const auto build = [&] { return data_.Build(path, out()); };
  WriteText(path, "");
  ExpectRefused(build(), kBadData, {"strange.geojson"});
  WriteText(path, "{\"type\": \"FeatureCollection\", \"features\": [{\"type\": \"Feat");
  ExpectRefused(build(), kBadData, {"strange.geojson"});
  WriteText(path, "<kml></kml>\n");
  ExpectRefused(build(), kBadData, {"strange.geojson"});
  fs::remove(path);
  ExpectRefused(build(), kNotFound, {"strange.geojson", "no such file", "check the path"});
}

TEST_F(BadDataSet, CamerasAreChecked) {
  const fs::path camera = data_.root() / "bent_camera.yaml";
  const auto build = [&](const std::string& from, const std::string& to) {
    fs::copy_file(data_.camera(), camera, fs::copy_options::overwrite_existing);
    ReplaceInFile(camera, from, to);
    return Builder({"build", "--panoramas", data_.panoramas().string(), "--camera", camera.string(),
                    "--out", out().string()});
  };
  const std::string mend = "camera_info";
  ExpectRefused(build("image_width", "width"), kBadData,
                {"bent_camera.yaml", "'image_width' is missing", mend});
  ExpectRefused(build("distortion_model", "model"), kBadData,
                {"bent_camera.yaml", "'distortion_model' is missing", mend});
  ExpectRefused(build("plumb_bob", "fisheye"), kBadData,
                {"bent_camera.yaml", "'fisheye' is unknown", "plumb_bob or rational_polynomial"});
  ExpectRefused(build("image_height: 180", "image_height: 0"), kBadData, {"bent_camera.yaml"});
  ExpectRefused(build("data: [", "data: [.nan, "), kBadData, {"bent_camera.yaml"});
  ExpectRefused(Builder({"build", "--panoramas", data_.panoramas().string(), "--camera",
                         "nowhere.yaml", "--out", out().string()}),
                kNotFound, {"nowhere.yaml", "name an existing"});
  EXPECT_FALSE(fs::exists(out()));
}

}  // namespace
}  // namespace panofix::e2e
