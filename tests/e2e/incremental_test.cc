// Night after night: only what changed is made again, and only the tiles it touches change.
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/e2e/staged_build.h"

namespace panofix::e2e {
namespace {

namespace fs = std::filesystem;

constexpr int kStreets = 20, kPerStreet = 5;  // a hundred panoramas: one is 1 %

// Of a bundle, in a night with 1 % changed panoramas.
constexpr double kMostShipped = 0.05;

// One small street, at twenty places of a city a kilometre apart.
class IncrementalBuild : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    data_ = std::make_unique<TownData>(std::vector<std::string>{
        "--seed", "5", "--panoramas", std::to_string(kPerStreet), "--no-drive", "--pano-width-px",
        "320", "--frame-width-px", "120", "--frame-height-px", "90"});
    city_ = City();
    Night("first", city_, {});
    first_ = ReadTree(data_->root() / "first");
  }
  static void TearDownTestSuite() { data_.reset(); }
  void SetUp() override { ASSERT_GE(Tiles(first_).size(), std::size_t{kStreets}); }

  static Json City() {
    const Json street = ReadJson(data_->panoramas());
    Json city = street;
    city["features"] = Json::array();
    for (int s = 0; s < kStreets; ++s) {
      for (Json feature : street["features"]) {
        const std::string prefix = "street" + std::to_string(s) + "-";
        feature["id"] = prefix + feature["id"].get<std::string>();
        for (Json& link : feature["properties"]["links"]) link = prefix + link.get<std::string>();
        Json& lat_deg = feature["geometry"]["coordinates"][1];
        lat_deg = lat_deg.get<double>() + 0.01 * s;
        city["features"].push_back(feature);
      }
    }
    return city;
  }
  // A build over what the first night left, with its vocabulary.
  static Outcome TryNight(const std::string& name, const Json& set,
                          std::vector<std::string> options) {
    const fs::path work = data_->root() / (name + ".work");
    if (name != "first") {
      CopyFolder(data_->root() / "first.work", work);
      options.insert(options.end(),
                     {"--vocabulary", (data_->root() / "first" / "vocabulary.h5").string()});
    }
    options.insert(options.end(), {"--name", "city", "--work", work.string(), "--views", "4",
                                   "--station-spacing-m", "6", "--geotag-sigma-m", "0.1"});
    return data_->Build(WriteDataSet(*data_, name + ".geojson", set), data_->root() / name,
                        options);
  }
  static Files Night(const std::string& name, const Json& set, std::vector<std::string> options) {
    const Outcome outcome = TryNight(name, set, std::move(options));
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    return outcome.exit_code == 0 ? ReadTree(data_->root() / name) : Files{};
  }
  static Json Stage(const std::string& night, const std::string& stage) {
    const Json report = ReadJson(data_->root() / (night + ".report.json"));
    for (const Json& s : report["stages"]) {
      if (s["name"] == stage) return s;
    }
    ADD_FAILURE() << night << " has no stage " << stage;
    return {};
  }
  static int NumMade(const std::string& night, const std::string& stage) {
    const Json s = Stage(night, stage);
    return s["num_items"].get<int>() - s["num_reused"].get<int>();
  }
  // Size of the package from the first night's bundle to this one's, as a share of this one.
  static double ShippedShare(const std::string& night) {
    const std::string key = data_->root() / (night + ".key"), bundle = data_->root() / night,
                      package = bundle + ".pfb";
    for (const std::vector<std::string>& command :
         {std::vector<std::string>{"keygen", "--key", key, "--public", key + ".pub"},
          {"sign", bundle, "--key", key},
          {"delta", data_->root() / "first", bundle, "--out", package}}) {
      const Outcome outcome = Builder(command);
      EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    }
    std::uintmax_t num_bytes = 0;
    for (const auto& [path, bytes] : ReadTree(bundle)) num_bytes += bytes.size();
    return static_cast<double>(fs::file_size(package)) / static_cast<double>(num_bytes);
  }
  static Files Tiles(const Files& files) {
    Files tiles;
    for (const auto& [path, bytes] : files) {
      if (path.starts_with("tiles/")) tiles[path] = bytes;
    }
    return tiles;
  }
  // Tiles of the first night that are there to the byte.
  static std::size_t NumSameTiles(const Files& files) {
    std::size_t num = 0;
    for (const auto& [path, bytes] : Tiles(first_)) {
      const auto found = files.find(path);
      num += found != files.end() && found->second == bytes ? 1 : 0;
    }
    return num;
  }

  static inline std::unique_ptr<TownData> data_;
  static inline Json city_;
  static inline Files first_;
};

TEST_F(IncrementalBuild, ANightWithoutNewsChangesTheManifestAlone) {
  const Files files = Night("quiet", city_, {"--build", "2"});
  ASSERT_EQ(files.size(), first_.size());
  for (const auto& [path, bytes] : first_)
    EXPECT_EQ(files.at(path) == bytes, !path.starts_with("manifest")) << path;
  for (const char* stage : {"extract", "augment", "train", "words", "landmarks", "similarity"})
    EXPECT_EQ(NumMade("quiet", stage), 0) << stage;
}

TEST_F(IncrementalBuild, OnePanoramaOfAHundredTouchesItsTileAlone) {
  Json set = city_;
  set["features"][2]["properties"]["image"] = set["features"][3]["properties"]["image"];
  const Files files = Night("changed", set, {});
  EXPECT_EQ(NumMade("changed", "extract"), 1);
  EXPECT_LE(NumMade("changed", "augment"), kPerStreet);
  EXPECT_LE(NumMade("changed", "words"), kPerStreet);
  const std::size_t num_tiles = Tiles(first_).size();
  EXPECT_LT(NumSameTiles(files), num_tiles);
  EXPECT_GE(static_cast<double>(NumSameTiles(files)), 0.95 * static_cast<double>(num_tiles));
  EXPECT_TRUE(files.at("vocabulary.h5") == first_.at("vocabulary.h5"));
  const Json redone = Stage("changed", "extract")["redone"];
  ASSERT_EQ(redone.size(), 1U);
  EXPECT_EQ(redone[0]["id"], city_["features"][2]["id"]);
  EXPECT_EQ(redone[0]["why"], "image");
  const Json tiles = Stage("changed", "landmarks")["redone"];
  ASSERT_GE(tiles.size(), 1U);
  EXPECT_NE(tiles[0]["why"].get<std::string>().find(city_["features"][2]["id"]), std::string::npos);
  EXPECT_LE(ShippedShare("changed"), kMostShipped);
  // The oracle: the same night from nothing.
  ExpectSameFiles(files, Night("changed-anew", set, {}));
  fs::remove_all(data_->root() / "fresh.work");
  const Outcome fresh =
      data_->Build(data_->town() / "changed.geojson", data_->root() / "fresh",
                   {"--name", "city", "--work", (data_->root() / "fresh.work").string(), "--views",
                    "4", "--station-spacing-m", "6", "--geotag-sigma-m", "0.1", "--vocabulary",
                    (data_->root() / "first").string()});
  ASSERT_EQ(fresh.exit_code, 0) << fresh.errors;
  ExpectSameFiles(ReadTree(data_->root() / "fresh"), files);
}

TEST_F(IncrementalBuild, ARemovedPanoramaDisappears) {
  Json set = city_;
  const std::string gone = set["features"][7]["id"];
  set["features"].erase(7);
  const Files files = Night("removed", set, {});
  EXPECT_EQ(NumMade("removed", "extract"), 0);
  EXPECT_GE(static_cast<double>(NumSameTiles(files)),
            0.95 * static_cast<double>(Tiles(first_).size()));
  for (const auto& [path, bytes] : files)
    EXPECT_EQ(bytes.find(gone), std::string::npos) << path << " still names " << gone;
  EXPECT_NE(first_.at("graph.h5").find(gone), std::string::npos);
  const Json tiles = Stage("removed", "landmarks")["redone"];
  ASSERT_GE(tiles.size(), 1U);
  EXPECT_NE(tiles[0]["why"].get<std::string>().find("is gone"), std::string::npos);
}

TEST_F(IncrementalBuild, AReleaseSaysWhatItIs) {
  const fs::path release = data_->root() / "first" / "vocabulary.h5";
  const Outcome outcome = Builder({"inspect", release.string(), "--json"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  const Json j = Json::parse(outcome.output);
  EXPECT_EQ(j["sift"]["num_words"], 500);
  EXPECT_EQ(j["mser"]["num_words"], 200);
  EXPECT_GT(j["typical_share"].get<double>(), j["mean_share"].get<double>());
  EXPECT_LT(j["typical_share"].get<double>(), 1.0);
  const Json report = ReadJson(data_->root() / "first.report.json");
  EXPECT_EQ(report["vocabulary_release"], j["name"]);
  EXPECT_NEAR(report["saturation"]["typical_share"].get<double>(), j["typical_share"].get<double>(),
              1e-5);
  EXPECT_EQ(Builder({"inspect", (data_->town() / "camera.yaml").string()}).exit_code, 65);
  // A build with it says the words that it has, whatever was asked for.
  const fs::path work = data_->root() / "again.work";
  const Outcome again =
      Builder({"plan", "--panoramas", data_->panoramas(), "--camera", data_->camera(), "--out",
               (data_->root() / "again").string(), "--work", work.string(), "--vocabulary",
               release.string(), "--sift-words", "900"});
  ASSERT_EQ(again.exit_code, 0) << again.errors;
  EXPECT_EQ(ReadJson(work / "plan.json")["options"]["num_sift_words"], 500);
  // Words of other descriptors would say nothing.
  const Outcome other =
      data_->Build(data_->panoramas(), data_->root() / "plain",
                   {"--plain-sift", "--vocabulary", (data_->root() / "first").string()});
  EXPECT_EQ(other.exit_code, 64) << other.errors;
}

// The frame's origin moves with the data; tiles do not know it.
TEST_F(IncrementalBuild, AStreetMoreLeavesEveryTileAsItWas) {
  Json set = city_;
  for (int i = 0; i < kPerStreet; ++i) {
    Json feature = city_["features"][static_cast<std::size_t>(i)];
    feature["id"] = "new-" + std::to_string(i);
    feature["properties"]["links"] = Json::array();
    Json& lon_deg = feature["geometry"]["coordinates"][0];
    lon_deg = lon_deg.get<double>() + 0.02;
    set["features"].push_back(feature);
  }
  const Files files = Night("grown", set, {});
  EXPECT_EQ(NumMade("grown", "extract"), kPerStreet);
  EXPECT_EQ(NumSameTiles(files), Tiles(first_).size());
  EXPECT_GT(Tiles(files).size(), Tiles(first_).size());
}

TEST_F(IncrementalBuild, OnePercentBrokenDoesNotStopACity) {
  Json set = city_;
  const fs::path broken = data_->town() / "broken.jpg";
  fs::copy_file(data_->town() / set["features"][0]["properties"]["image"].get<std::string>(),
                broken, fs::copy_options::overwrite_existing);
  TruncateFile(broken, 0.5);
  set["features"][12]["properties"]["image"] = "broken.jpg";
  (void)Night("broken", set, {"--max-set-aside-share", "0.01"});
  const Json report = ReadJson(data_->root() / "broken.report.json");
  ASSERT_EQ(report["set_aside"].size(), 1U);
  EXPECT_EQ(report["set_aside"][0]["id"], set["features"][12]["id"]);
  const Outcome refused = TryNight("refused", set, {"--max-set-aside-share", "0.005"});
  EXPECT_EQ(refused.exit_code, 65) << refused.errors;
  EXPECT_NE(refused.errors.find("1 of 100"), std::string::npos) << refused.errors;
  EXPECT_FALSE(fs::exists(data_->root() / "refused"));
}

}  // namespace
}  // namespace panofix::e2e
