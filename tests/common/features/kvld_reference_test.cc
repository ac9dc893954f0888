// Agreement with what the method's authors published for their own input.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <numbers>
#include <set>

#include "common/features/kvld.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;
using Pairs = std::set<std::pair<int, int>>;

constexpr double kMinShareKept = 0.95;  // of the published matches
constexpr double kMaxCountOff = 0.10;   // against their number
constexpr std::size_t kMaxImageBytes = std::size_t{64} << 20;

GradientPyramid ReadPyramid(const fs::path& path) {
  return GradientPyramid(DecodeGray(ReadFileBytes(path, kMaxImageBytes).value()).value());
}

// Lines "x y scale angle": the scale is half of OpenCV's size, the angle in radians.
std::vector<Keypoint> ReadKeypoints(const fs::path& path) {
  std::ifstream file(path);
  std::size_t count = 0;
  file >> count;
  std::vector<Keypoint> keypoints(count);
  for (Keypoint& k : keypoints) {
    double scale = 0, angle = 0;
    file >> k.x_px >> k.y_px >> scale >> angle;
    k.size_px = static_cast<float>(2 * scale);
    k.angle_deg = static_cast<float>(angle * 180 / std::numbers::pi);
  }
  EXPECT_TRUE(file) << path;
  return keypoints;
}

std::vector<FeatureMatch> ReadMatches(const fs::path& path) {
  std::ifstream file(path);
  std::size_t count = 0;
  file >> count;
  std::vector<FeatureMatch> matches(count);
  for (FeatureMatch& m : matches) file >> m.query_idx >> m.database_idx;
  EXPECT_TRUE(file) << path;
  return matches;
}

TEST(KvldReference, KeepsWhatTheAuthorsKept) {
  const fs::path folder = fs::path(PANOFIX_EVALUATION_DATA) / "kvld";
  int num_compared = 0;
  for (const std::string pair : {"IMG_0", "IMG_2", "IMG_3", "IMG_4"}) {
    for (const std::string year : {"2014", "2020"}) {
      const auto path = [&](const std::string& what) {
        return folder / "reference_output" / year / (pair + "_" + what + ".txt");
      };
      if (!fs::exists(path("kvld_matches"))) continue;  // published for some pairs only
      SCOPED_TRACE(year + " " + pair);
      const auto matches = ReadMatches(path("initial_matches"));
      Pairs theirs, ours;
      for (const FeatureMatch& m : ReadMatches(path("kvld_matches"))) {
        theirs.emplace(m.query_idx, m.database_idx);
      }
      const std::vector<int> kept = FilterKvld(
          ReadPyramid(folder / (pair + ".jpg")), ReadKeypoints(path("Detectors1")),
          ReadPyramid(folder / (pair + "bis.jpg")), ReadKeypoints(path("Detectors2")), matches, {});
      for (const int i : kept) {
        const FeatureMatch& m = matches[static_cast<std::size_t>(i)];
        ours.emplace(m.query_idx, m.database_idx);
      }
      std::size_t num_common = 0;
      for (const auto& match : theirs) num_common += ours.count(match);
      const auto count = static_cast<double>(theirs.size());
      EXPECT_GE(static_cast<double>(num_common), kMinShareKept * count);
      EXPECT_NEAR(static_cast<double>(ours.size()), count, kMaxCountOff * count);
      RecordProperty("common_" + year + "_" + pair, static_cast<int>(num_common));
      ++num_compared;
    }
  }
  if (num_compared == 0) {
    GTEST_SKIP() << "no evaluation data at " << folder << "; set PANOFIX_EVALUATION_DATA";
  }
}

}  // namespace
}  // namespace panofix
