// Real panoramas, real frames, truth good to 0.15 m: the Paris development split.
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/e2e/data_set.h"
#include "tests/e2e/truth.h"

namespace panofix::e2e {
namespace {

namespace fs = std::filesystem;

// Frames 721..737 look at mapped street; the rest lies beyond the last panorama, where no fix is
// the right answer.
constexpr std::size_t kFirstFrame = 721, kLastMappedFrame = 737;
constexpr double kWantedMedian_m = 0.25;

std::size_t FrameNumber(const DriveFrame& frame) { return std::stoul(frame.image.stem().string()); }

TEST(Paris, MappedFramesAreFixedAndNoOthers) {
  const fs::path data = fs::path(PANOFIX_EVALUATION_DATA) / "paris";
  if (!fs::exists(data / "panoramas.geojson")) {
    GTEST_SKIP() << "no evaluation data at " << data << "; set PANOFIX_EVALUATION_DATA";
  }
  const fs::path drive_folder = data / "drive_front";
  const TempFolder folder;
  const fs::path map = folder / "map", poses = folder / "poses.csv", json = folder / "score.json";
  constexpr double kPatience_s = 500;
  Process builder(
      BuilderCommand({"build", "--panoramas", (data / "panoramas.geojson").string(), "--camera",
                      (drive_folder / "camera.yaml").string(), "--out", map.string()}));
  ASSERT_EQ(builder.Wait(kPatience_s), 0) << builder.Errors();
  const Json report = ReadJson(map.string() + ".report.json");
  EXPECT_EQ(report["set_aside"].size(), 0U);
  EXPECT_EQ(report["without_depth"].size(), 0U);
  const Outcome validate =
      Builder({"validate", map.string(), "--drive", drive_folder.string(), "--poses",
               poses.string(), "--json", json.string(), "--min-share-1m", "0.6"});
  EXPECT_EQ(validate.exit_code, 0) << validate.errors << validate.output;

  const Drive drive = ReadDrive(drive_folder).value();
  const std::vector<PoseRow> rows = ReadPosesCsv(poses).value();
  ASSERT_EQ(rows.size(), drive.frames.size());
  const auto errors_m = FixErrors_m(rows, drive);
  std::vector<double> mapped_m;
  for (const DriveFrame& frame : drive.frames) {
    const auto found = errors_m.find(frame.timestamp_ns);
    if (found == errors_m.end()) continue;
    const std::size_t number = FrameNumber(frame);
    EXPECT_LT(found->second, 1) << "frame " << number;
    ASSERT_TRUE(number >= kFirstFrame && number <= kLastMappedFrame) << "frame " << number;
    mapped_m.push_back(found->second);
  }
  ASSERT_EQ(mapped_m.size(), kLastMappedFrame - kFirstFrame + 1) << validate.output;
  std::sort(mapped_m.begin(), mapped_m.end());
  EXPECT_LE(mapped_m[mapped_m.size() / 2], kWantedMedian_m);
}

}  // namespace
}  // namespace panofix::e2e
