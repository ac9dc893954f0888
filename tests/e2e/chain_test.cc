// From panoramas to scored poses through the real programs.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <sstream>

#include "tests/e2e/data_set.h"
#include "tests/e2e/truth.h"

namespace panofix::e2e {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

constexpr std::size_t kNumPanoramas = 4, kNumFrames = 4;  // of EasyTown
constexpr double kFalseFix_m = 5;                         // the contract's
constexpr double kGoodMedian_m = 0.5;
// What the builder's score and this test's own arithmetic may differ by: rounding of poses.csv.
constexpr double kScoreTolerance_m = 1e-3;

class Chain : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    data_ = std::make_unique<TownData>(EasyTown());
    built_ = data_->Build(data_->panoramas(), bundle());
    localized_ = data_->Localize(bundle(), data_->drive(), poses());
  }
  static void TearDownTestSuite() { data_.reset(); }
  void SetUp() override {
    ASSERT_EQ(built_.exit_code, 0) << built_.errors;
    ASSERT_EQ(localized_.exit_code, 0) << localized_.errors;
  }

  static fs::path bundle() { return data_->root() / "map"; }
  static fs::path poses() { return data_->root() / "poses.csv"; }
  // The first frames of the drive: what they are answered depends on nothing after them.
  static fs::path ShortDrive(int num_frames) {
    const fs::path drive = data_->root() / ("drive" + std::to_string(num_frames));
    CopyFolder(data_->drive(), drive);
    std::istringstream rows(ReadText(drive / "frames.csv"));
    std::string text, line;
    for (int i = 0; i <= num_frames && std::getline(rows, line); ++i) text += line + "\n";
    WriteText(drive / "frames.csv", text);
    return drive;
  }
  static Drive ReadTruth() { return ReadDrive(data_->drive()).value(); }
  static std::vector<PoseRow> ReadPoses(const fs::path& path) { return ReadPosesCsv(path).value(); }

  static inline std::unique_ptr<TownData> data_;
  static inline Outcome built_, localized_;
};

// All of a row but its latency.
std::string Answer(PoseRow row) {
  row.latency_ms = 0;
  return PosesCsvRow(row);
}

TEST_F(Chain, InspectSaysWhatTheBundleIs) {
  const Outcome outcome = Builder({"inspect", bundle().string(), "--json"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  const Json json = Json::parse(outcome.output);
  const Json& manifest = json["manifest"];
  EXPECT_EQ(manifest["counts"]["panoramas"], kNumPanoramas);
  // One rendered station in the middle of each gap, and one beyond each end.
  EXPECT_EQ(manifest["counts"]["stations"], 2 * kNumPanoramas + 1);
  EXPECT_EQ(manifest["counts"]["views"], 8 * (2 * kNumPanoramas + 1));
  EXPECT_EQ(manifest["counts"]["set_aside"], 0);
  EXPECT_GT(manifest["counts"]["landmarks"], 1000);
  EXPECT_EQ(manifest["name"], "map");
  EXPECT_EQ(manifest["provenance"]["source"], "panofix-town, seed 4");
  EXPECT_EQ(json["coverage"]["panoramas_with_depth"], kNumPanoramas);
  // Three gaps of 8 m; geotags err by 0.05 m and a street may bend.
  EXPECT_NEAR(json["coverage"]["route_m"].get<double>(), 24, 2);
  std::uintmax_t num_bytes = 0;
  for (const auto& file : fs::recursive_directory_iterator(bundle())) {
    if (file.is_regular_file()) num_bytes += file.file_size();
  }
  for (const Json& part : manifest["parts"]) {
    EXPECT_EQ(fs::file_size(bundle() / part["path"].get<std::string>()), part["num_bytes"]);
  }
  EXPECT_EQ(json["num_bytes"], num_bytes);
  const Outcome text = Builder({"inspect", bundle().string()});
  EXPECT_EQ(text.exit_code, 0);
  EXPECT_THAT(text.output, HasSubstr(json["id"].get<std::string>()));
}

TEST_F(Chain, EveryFrameHasItsRowAndFixesAreTrue) {
  const Drive drive = ReadTruth();
  const std::vector<PoseRow> rows = ReadPoses(poses());
  ASSERT_EQ(rows.size(), kNumFrames);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    EXPECT_EQ(rows[i].timestamp_ns, drive.frames[i].timestamp_ns);
    EXPECT_EQ(rows[i].pose.has_value(), rows[i].status != FixStatus::kNoFix);
    EXPECT_EQ(rows[i].reason.empty(), rows[i].status == FixStatus::kFix);
    if (!rows[i].pose) continue;
    EXPECT_GT(rows[i].pose->sigma_east_m, 0);
    EXPECT_GT(rows[i].pose->sigma_north_m, 0);
    EXPECT_GT(rows[i].num_inliers, 0);
    EXPECT_THAT(rows[i].best_panorama, HasSubstr("pano-"));
  }
  std::vector<double> errors_m;
  for (const auto& [timestamp_ns, error_m] : FixErrors_m(rows, drive)) errors_m.push_back(error_m);
  ASSERT_GE(2 * errors_m.size(), kNumFrames);
  std::sort(errors_m.begin(), errors_m.end());
  EXPECT_LT(errors_m[errors_m.size() / 2], kGoodMedian_m);
  EXPECT_LT(errors_m.back(), kFalseFix_m);
}

TEST_F(Chain, AnswersRepeatForAnyNumberOfThreads) {
  const fs::path again = data_->root() / "again.csv";
  ASSERT_EQ(data_->Localize(bundle(), data_->drive(), again, {"--threads", "1"}).exit_code, 0);
  const std::vector<PoseRow> first = ReadPoses(poses()), second = ReadPoses(again);
  ASSERT_EQ(first.size(), second.size());
  for (std::size_t i = 0; i < first.size(); ++i) EXPECT_EQ(Answer(first[i]), Answer(second[i]));
}

TEST_F(Chain, ValidateScoresAndItsGateOpensAndCloses) {
  const fs::path json = data_->root() / "score.json", picture = data_->root() / "view.svg",
                 kept = data_->root() / "validated.csv";
  const Outcome holds = Builder({"validate", bundle().string(), "--drive", data_->drive().string(),
                                 "--json", json.string(), "--picture", picture.string(), "--poses",
                                 kept.string(), "--min-share-1m", "0.25"});
  EXPECT_EQ(holds.exit_code, 0) << holds.errors;
  for (const char* row : {"within (0.25 m, 2 deg)", "false fixes", "longest gap", "NEES median",
                          "latency total", "resident memory", "comparisons avoided"}) {
    EXPECT_THAT(holds.output, HasSubstr(row));
  }
  const auto errors_m = FixErrors_m(ReadPoses(kept), ReadTruth());
  const Json score = ReadJson(json);
  EXPECT_EQ(score["num_frames"], kNumFrames);
  EXPECT_EQ(score["num_fixes"], errors_m.size());
  for (const Json& frame : score["frames"]) {
    if (frame["status"] != "fix") continue;
    EXPECT_NEAR(frame["position_error_m"].get<double>(),
                errors_m.at(frame["timestamp_ns"].get<std::int64_t>()), kScoreTolerance_m);
  }
  EXPECT_THAT(ReadText(picture), testing::ContainsRegex("<svg(.|\n)*</svg>"));

  // A black frame cannot be fixed, so not all frames are.
  const fs::path dark = CopyFolder(ShortDrive(1), data_->root() / "dark");
  for (const auto& image : fs::directory_iterator(dark / "images"))
    WriteText(image.path(), "no image");
  const Outcome breaks =
      Builder({"validate", bundle().string(), "--drive", dark.string(), "--min-fix-share", "1"});
  EXPECT_EQ(breaks.exit_code, 1) << breaks.errors;
  EXPECT_THAT(breaks.errors, HasSubstr("--min-fix-share"));
}

TEST_F(Chain, ScoreReadsWhatLocalizeWrote) {
  const fs::path json = data_->root() / "scored.json";
  const Outcome outcome =
      Builder({"score", "--poses", poses().string(), "--drive", data_->drive().string(), "--bundle",
               bundle().string(), "--json", json.string()});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  EXPECT_EQ(ReadJson(json)["num_fixes"], FixErrors_m(ReadPoses(poses()), ReadTruth()).size());
}

std::vector<std::string> Lines(const std::string& text, const std::string& holding) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) {
    if (line.find(holding) != std::string::npos) lines.push_back(line);
  }
  return lines;
}

TEST_F(Chain, OtherFormatsHoldTheSamePoses) {
  constexpr std::size_t kNumRows = 2;
  const fs::path drive = ShortDrive(kNumRows);
  std::vector<PoseRow> posed = ReadPoses(poses());
  posed.resize(kNumRows);
  std::erase_if(posed, [](const PoseRow& row) { return !row.pose; });
  ASSERT_FALSE(posed.empty());
  const auto written = [&](const std::string& format) {
    const fs::path out = data_->root() / ("poses." + format);
    EXPECT_EQ(data_->Localize(bundle(), drive, out, {"--format", format}).exit_code, 0);
    return ReadText(out);
  };
  const Json geojson = Json::parse(written("geojson"));
  ASSERT_EQ(geojson["features"].size(), posed.size());
  for (std::size_t i = 0; i < posed.size(); ++i) {
    const Json& at = geojson["features"][i]["geometry"]["coordinates"];
    const Geodetic position{at[1], at[0], at[2]};
    EXPECT_LT(Distance_m(posed[i].pose->position, position), kScoreTolerance_m);
  }
  EXPECT_EQ(Lines(written("gpx"), "<trkpt ").size(), posed.size());
  const std::vector<std::string> tum = Lines(written("tum"), ".");
  ASSERT_EQ(tum.size(), posed.size() + 1);  // and the comment with the origin
  double seconds = 0, x_m = 0, y_m = 0, z_m = 0;
  std::istringstream(tum.back()) >> seconds >> x_m >> y_m >> z_m;
  EXPECT_NEAR(std::hypot(x_m, y_m, z_m),
              Distance_m(posed.front().pose->position, posed.back().pose->position),
              kScoreTolerance_m);
}

TEST_F(Chain, OnePanoramaIsAMap) {
  Json set = ReadJson(data_->panoramas());
  set["features"] = Json::array({set["features"][1]});
  const fs::path map = data_->root() / "one", out = data_->root() / "one.csv";
  const Outcome built = data_->Build(WriteDataSet(*data_, "one.geojson", set), map);
  ASSERT_EQ(built.exit_code, 0) << built.errors;
  ASSERT_EQ(data_->Localize(map, data_->drive(), out).exit_code, 0);
  const std::vector<PoseRow> rows = ReadPoses(out);
  EXPECT_EQ(rows.size(), kNumFrames);
  const auto errors_m = FixErrors_m(rows, ReadTruth());
  EXPECT_GE(errors_m.size(), 1U);
  for (const auto& [timestamp_ns, error_m] : errors_m) EXPECT_LT(error_m, kFalseFix_m);
}

TEST_F(Chain, PaperPresetRunsTheWholeWay) {
  const fs::path map = data_->root() / "paper", out = data_->root() / "paper.csv";
  const Outcome built = data_->Build(data_->panoramas(), map, {"--preset", "paper"});
  ASSERT_EQ(built.exit_code, 0) << built.errors;
  EXPECT_EQ(ReadJson(map / "manifest.json")["preprocessing"]["equalization"], "global");
  ASSERT_EQ(data_->Localize(map, data_->drive(), out, {"--preset", "paper"}).exit_code, 0);
  const std::vector<PoseRow> rows = ReadPoses(out);
  EXPECT_EQ(rows.size(), kNumFrames);
  for (const auto& [timestamp_ns, error_m] : FixErrors_m(rows, ReadTruth())) {
    EXPECT_LT(error_m, kFalseFix_m);
  }
}

}  // namespace
}  // namespace panofix::e2e
