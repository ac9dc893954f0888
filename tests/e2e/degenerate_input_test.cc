// What cameras do on bad days: dark, blinded, frozen, upside down, wrongly calibrated, off the map.
// Whatever comes, a fix is honest: within 4 of its stated sigmas, or half a metre.
#include <gtest/gtest.h>

#include <algorithm>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "common/base/log.h"
#include "common/map/map_bundle.h"
#include "runtime/retrieval/retrieval.h"
#include "tests/e2e/data_set.h"
#include "tests/e2e/truth.h"

namespace panofix::e2e {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kNumPanoramas = 6, kNumFrames = 8, kNumOffMap = 3;
constexpr double kFalseFix_m = 5;      // the contract's
constexpr double kSmallError_m = 0.5;  // below it no sigma is asked after
constexpr double kHonestSigmas = 4;
constexpr std::int64_t kTenth_ns = 100'000'000;

// A frame as a drive has it, and the frame of the town that shows the same (its truth).
struct Shot {
  std::int64_t timestamp_ns = 0;
  std::string image;  // from the drive's folder
  std::size_t source = 0;
};

double Sigma_m(const PoseColumns& pose) {
  return std::hypot(pose.sigma_east_m, pose.sigma_north_m, pose.sigma_up_m);
}

std::size_t CountFixes(const std::vector<PoseRow>& rows) {
  return static_cast<std::size_t>(std::count_if(
      rows.begin(), rows.end(), [](const PoseRow& r) { return r.status == FixStatus::kFix; }));
}

class DegenerateInput : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    data_ = std::make_unique<TownData>(std::vector<std::string>{
        "--seed", "4", "--panoramas", std::to_string(kNumPanoramas), "--spacing-m", "8",
        "--pano-width-px", "1600", "--frames", std::to_string(kNumFrames), "--off-map-frames",
        std::to_string(kNumOffMap), "--frame-width-px", "400", "--frame-height-px", "300",
        "--same-light"});
    built_ = BuildByDefault(data_->panoramas(), data_->root() / "map");
    drive_ = ReadDrive(data_->drive()).value();
    if (built_.exit_code == 0) rows_ = Run(data_->root() / "map", data_->drive());
  }
  static void TearDownTestSuite() { data_.reset(); }
  void SetUp() override {
    ASSERT_EQ(built_.exit_code, 0) << built_.errors;
    ASSERT_EQ(rows_.size(), kNumFrames + kNumOffMap);
  }

  // With the product's own defaults, unlike TownData::Build.
  static Outcome BuildByDefault(const fs::path& panoramas, const fs::path& out) {
    return Builder({"build", "--panoramas", panoramas.string(), "--camera",
                    data_->camera().string(), "--out", out.string(), "--work",
                    (data_->root() / "work").string()});
  }
  static std::vector<PoseRow> Run(const fs::path& bundle, const fs::path& drive) {
    const fs::path out = data_->root() / "rows.csv";
    const Outcome outcome = data_->Localize(bundle, drive, out);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    return ReadPosesCsv(out).value();
  }
  static fs::path bundle() { return data_->root() / "map"; }

  // A drive of these frames; the town's own images are there too. Time runs as the list does.
  static fs::path MakeDrive(const std::string& name, const std::vector<Shot>& shots) {
    const fs::path folder = CopyFolder(data_->drive(), data_->root() / name);
    std::string text = "timestamp_ns,image\n";
    for (const Shot& shot : shots) {
      text += std::to_string(shot.timestamp_ns) + "," + shot.image + "\n";
    }
    WriteText(folder / "frames.csv", text);
    return folder;
  }
  static Shot TownShot(std::size_t frame) {
    const DriveFrame& of = drive_.frames[frame];
    return {of.timestamp_ns, "images/" + of.image.filename().string(), frame};
  }
  static cv::Mat TownImage(std::size_t frame) {
    return cv::imread(drive_.frames[frame].image.string(), cv::IMREAD_COLOR);
  }
  static double Error_m(const PoseRow& row, std::size_t source) {
    return Distance_m(drive_.truth[source].position, row.pose->position);
  }
  // A row for each frame; poses exactly where there is no `no_fix`; every fix honest.
  static void ExpectHonest(const std::vector<PoseRow>& rows, const std::vector<Shot>& shots) {
    ASSERT_EQ(rows.size(), shots.size());
    for (std::size_t i = 0; i < rows.size(); ++i) {
      EXPECT_EQ(rows[i].timestamp_ns, shots[i].timestamp_ns) << i;
      EXPECT_EQ(rows[i].reason.empty(), rows[i].status == FixStatus::kFix) << i;
      EXPECT_NE(rows[i].reason, "internal_error") << i;
      if (rows[i].status != FixStatus::kFix) continue;
      EXPECT_LE(Error_m(rows[i], shots[i].source),
                std::max(kSmallError_m, kHonestSigmas * Sigma_m(*rows[i].pose)))
          << "frame " << i << " of town frame " << shots[i].source << ", sigma "
          << Sigma_m(*rows[i].pose) << " m, " << rows[i].num_inliers << " inliers";
    }
  }
  // The mapped frames as they were recorded.
  static std::vector<Shot> MappedShots() {
    std::vector<Shot> shots;
    for (std::size_t i = 0; i < kNumFrames; ++i) shots.push_back(TownShot(i));
    return shots;
  }
  static std::size_t NumFixesOfTown() {
    return CountFixes({rows_.begin(), rows_.begin() + kNumFrames});
  }

  static inline std::unique_ptr<TownData> data_;
  static inline Outcome built_;
  static inline Drive drive_;
  static inline std::vector<PoseRow> rows_;  // of the town's drive as it is
};

// Without it the tests below could hold for a runtime that never answers.
TEST_F(DegenerateInput, TheGoodDayIsGood) {
  std::vector<Shot> shots;
  for (std::size_t i = 0; i < kNumFrames + kNumOffMap; ++i) shots.push_back(TownShot(i));
  ExpectHonest(rows_, shots);
  EXPECT_GE(NumFixesOfTown(), kNumFrames * 7 / 10);
}

// The town's own unmapped street still shows mapped houses at first; another town's shows none.
TEST_F(DegenerateInput, StreetsThatAreNotInTheMapHaveNoFix) {
  for (const char* seed : {"5", "21"}) {
    const TownData other({"--seed", seed, "--panoramas", "5", "--no-panoramas", "--frames", "6",
                          "--frame-width-px", "400", "--frame-height-px", "300"});
    const std::vector<PoseRow> rows = Run(bundle(), other.drive());
    ASSERT_EQ(rows.size(), 6U);
    for (const PoseRow& row : rows) {
      EXPECT_NE(row.status, FixStatus::kFix) << seed << ", " << row.timestamp_ns;
      EXPECT_FALSE(row.reason.empty());
    }
  }
}

TEST_F(DegenerateInput, BlackAndBlindedFramesHaveNoFixAndPass) {
  std::vector<Shot> shots = MappedShots();
  const std::int64_t step_ns = (shots[1].timestamp_ns - shots[0].timestamp_ns) / 4;
  std::vector<Shot> mixed;
  for (const Shot& shot : shots) {
    mixed.push_back(shot);
    mixed.push_back({shot.timestamp_ns + step_ns, "images/black.png", shot.source});
    mixed.push_back({shot.timestamp_ns + 2 * step_ns, "images/white.png", shot.source});
    mixed.push_back({shot.timestamp_ns + 3 * step_ns, "images/glare.png", shot.source});
  }
  const fs::path drive = MakeDrive("dark", mixed);
  const cv::Size size = TownImage(0).size();
  cv::imwrite((drive / "images/black.png").string(), cv::Mat(size, CV_8UC3, cv::Scalar::all(0)));
  cv::imwrite((drive / "images/white.png").string(), cv::Mat(size, CV_8UC3, cv::Scalar::all(255)));
  cv::Mat glare = TownImage(0) * 40;  // only the deepest shadows are left
  cv::imwrite((drive / "images/glare.png").string(), glare);
  const std::vector<PoseRow> rows = Run(bundle(), drive);
  ASSERT_EQ(rows.size(), mixed.size());
  std::vector<PoseRow> seen;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (i % 4 == 0) seen.push_back(rows[i]);
    if (i % 4 == 1 || i % 4 == 2) {
      EXPECT_EQ(rows[i].status, FixStatus::kNoFix) << i;
      EXPECT_EQ(rows[i].reason, "too_few_features") << i;
    }
    EXPECT_TRUE(i % 4 != 3 || rows[i].status != FixStatus::kFix) << i;
  }
  ExpectHonest(seen, shots);
  EXPECT_GE(CountFixes(seen) + 2, NumFixesOfTown());  // the dark costs little of what follows it
}

TEST_F(DegenerateInput, AFrozenCameraStaysWhereItIs) {
  const auto best = std::max_element(
      rows_.begin(), rows_.begin() + kNumFrames, [](const PoseRow& a, const PoseRow& b) {
        const bool fa = a.status == FixStatus::kFix, fb = b.status == FixStatus::kFix;
        return std::tie(fa, a.num_inliers) < std::tie(fb, b.num_inliers);
      });
  const auto source = static_cast<std::size_t>(best - rows_.begin());
  // Behind a moving run, so that there is a speed to be drawn on by.
  std::vector<Shot> shots;
  for (std::size_t i = 0; i <= source; ++i) shots.push_back(TownShot(i));
  constexpr std::size_t kNumFrozen = 10;
  for (std::size_t i = 1; i < kNumFrozen; ++i) {
    shots.push_back(TownShot(source));
    shots.back().timestamp_ns += static_cast<std::int64_t>(i) * kTenth_ns;
  }
  const std::vector<PoseRow> rows = Run(bundle(), MakeDrive("frozen", shots));
  ExpectHonest(rows, shots);
  ASSERT_EQ(rows.size(), shots.size());
  const PoseRow& first = rows[source];
  ASSERT_EQ(first.status, FixStatus::kFix);
  for (std::size_t i = source + 1; i < rows.size(); ++i) {
    ASSERT_EQ(rows[i].status, FixStatus::kFix) << i << ": " << rows[i].reason;
    EXPECT_LE(Distance_m(first.pose->position, rows[i].pose->position), Sigma_m(*first.pose)) << i;
  }
}

TEST_F(DegenerateInput, TimesOutOfOrderAndRepeatedMisleadNothing) {
  std::vector<Shot> shots = MappedShots();
  const std::vector<Shot> town = shots;
  std::reverse(shots.begin(), shots.end());  // driven backwards, the clock with it
  for (std::size_t i = 0; i < 3; ++i) {      // one clock for three places
    shots.push_back(town[2 * i]);
    shots.back().timestamp_ns = town[0].timestamp_ns;
  }
  for (std::size_t i = 0; i < 4; ++i) {  // swapped in pairs, the clock jumps to and fro
    shots.push_back(town[i ^ 1]);
  }
  shots.push_back(town[5]);
  shots.back().timestamp_ns = 0;
  shots.push_back(town[6]);
  shots.back().timestamp_ns = std::numeric_limits<std::int64_t>::max();
  const std::vector<PoseRow> rows = Run(bundle(), MakeDrive("times", shots));
  ExpectHonest(rows, shots);
  EXPECT_GE(2 * CountFixes(rows), shots.size());
}

TEST_F(DegenerateInput, AnUpsideDownCameraIsKnownOrRefused) {
  const std::vector<Shot> shots = MappedShots();
  const fs::path drive = MakeDrive("upside_down", shots);
  for (std::size_t i = 0; i < kNumFrames; ++i) {
    cv::Mat turned;
    cv::rotate(TownImage(i), turned, cv::ROTATE_180);
    cv::imwrite((drive / shots[i].image).string(), turned);
  }
  const std::vector<PoseRow> rows = Run(bundle(), drive);
  ExpectHonest(rows, shots);
  constexpr double kRollTolerance_deg = 5;
  for (const PoseRow& row : rows) {
    if (row.status != FixStatus::kFix) continue;
    EXPECT_NEAR(std::abs(row.pose->attitude.roll_deg), 180, kRollTolerance_deg);
  }
}

// A focal length 5 % off is explained nearly as well by a step back: what is off must be said.
TEST_F(DegenerateInput, AWrongCalibrationIsNotHidden) {
  const std::vector<Shot> shots = MappedShots();
  for (const double factor : {1.05, 0.95}) {
    const fs::path drive = MakeDrive(factor > 1 ? "long_focal" : "short_focal", shots);
    const Camera& camera = drive_.camera;
    WriteText(drive / "camera.yaml",
              Format("image_width: %d\nimage_height: %d\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
                     "  data: [%.9f, 0, %.9f, 0, %.9f, %.9f, 0, 0, 1]\n"
                     "distortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n"
                     "  cols: 5\n  data: [0, 0, 0, 0, 0]\n",
                     camera.width_px, camera.height_px, factor * camera.fx_px, camera.cx_px,
                     factor * camera.fy_px, camera.cy_px));
    const std::vector<PoseRow> rows = Run(bundle(), drive);
    SCOPED_TRACE(factor);
    ASSERT_EQ(rows.size(), shots.size());
    // One frame's finding is too weak to tell: it takes a second.
    ExpectHonest({rows.begin() + 2, rows.end()}, {shots.begin() + 2, shots.end()});
    const auto told = std::find_if(rows.begin(), rows.end(), [](const PoseRow& row) {
      return row.status == FixStatus::kDegraded && row.reason == "calibration_off";
    });
    EXPECT_NE(told, rows.end());
    EXPECT_EQ(CountFixes({told, rows.end()}), 0U);  // once it is known no pose is called sound
  }
}

// The town's data set without the depth of some panoramas.
template <typename Without>
fs::path WithoutDepth(const TownData& data, const std::string& name, Without without) {
  Json set = ReadJson(data.panoramas());
  for (std::size_t i = 0; i < set["features"].size(); ++i) {
    if (without(i)) set["features"][i]["properties"]["depth"] = nullptr;
  }
  return WriteDataSet(data, name, set);
}

// By the words of its pictures a panorama's views are the most similar to themselves.
void ExpectViewsFindThemselves(const fs::path& map, const std::string& panorama_id) {
  const std::shared_ptr<const MapBundle> bundle = MapBundle::Open(map).value();
  RetrievalOptions words_alone;
  words_alone.use_landmarks = false;
  const Retrieval retrieval(bundle, words_alone);
  const FeatureSet no_features;
  std::size_t num_views = 0;
  for (std::uint32_t v = 0; v < bundle->views().size(); ++v) {
    if (bundle->panoramas()[bundle->views()[v].panorama_idx].id != panorama_id) continue;
    const BagOfWords bag = bundle->BagOf(v);
    const RetrievalResult found =
        retrieval.Global({bag, no_features, {}, bundle->manifest().camera, {}});
    ASSERT_FALSE(found.views.empty());
    EXPECT_EQ(found.views[0].view_idx, v);
    ++num_views;
  }
  EXPECT_GE(num_views, bundle->views_per_station());
}

TEST_F(DegenerateInput, APanoramaWithoutDepthServesRetrieval) {
  const fs::path map = data_->root() / "gap";
  const Outcome built = BuildByDefault(
      WithoutDepth(*data_, "gap.geojson", [](std::size_t i) { return i == 3; }), map);
  ASSERT_EQ(built.exit_code, 0) << built.errors;
  const Json without_depth = ReadJson(map.string() + ".report.json")["without_depth"];
  ASSERT_EQ(without_depth.size(), 1U);
  ExpectViewsFindThemselves(map, without_depth[0]["id"].get<std::string>());
  const std::vector<Shot> shots = MappedShots();
  const std::vector<PoseRow> rows = Run(map, MakeDrive("gap_drive", shots));
  ExpectHonest(rows, shots);
  EXPECT_GE(CountFixes(rows), kNumFrames / 3);
}

TEST_F(DegenerateInput, AMapWithoutAnyDepthHasReasonsOnly) {
  const fs::path map = data_->root() / "flat";
  const Outcome built =
      BuildByDefault(WithoutDepth(*data_, "flat.geojson", [](std::size_t) { return true; }), map);
  ASSERT_EQ(built.exit_code, 0) << built.errors;
  const std::vector<PoseRow> rows = Run(map, MakeDrive("flat_drive", MappedShots()));
  ASSERT_EQ(rows.size(), kNumFrames);
  for (const PoseRow& row : rows) {
    EXPECT_EQ(row.status, FixStatus::kNoFix);
    EXPECT_FALSE(row.reason.empty());
    EXPECT_NE(row.reason, "internal_error");
  }
}

// One facade and one car all along the street: only the odd house tells places apart.
TEST(DegenerateTown, LookAlikesGiveNoFalseFix) {
  const TownData data({"--seed", "9", "--look-alikes", "--panoramas", "6", "--pano-width-px",
                       "1600", "--frames", "6", "--frame-width-px", "400", "--frame-height-px",
                       "300"});
  const fs::path map = data.root() / "map", out = data.root() / "poses.csv";
  const Outcome built = Builder({"build", "--panoramas", data.panoramas().string(), "--camera",
                                 data.camera().string(), "--out", map.string()});
  ASSERT_EQ(built.exit_code, 0) << built.errors;
  ASSERT_EQ(data.Localize(map, data.drive(), out).exit_code, 0);
  const std::vector<PoseRow> rows = ReadPosesCsv(out).value();
  EXPECT_EQ(rows.size(), 6U);
  for (const auto& [timestamp_ns, error_m] : FixErrors_m(rows, ReadDrive(data.drive()).value())) {
    EXPECT_LT(error_m, kFalseFix_m) << timestamp_ns;
  }
}

}  // namespace
}  // namespace panofix::e2e
