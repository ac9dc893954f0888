// Files: the depth format read back by a decoder of this test alone, equal bytes, exact truth.
#include "tests/town/writer.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <unistd.h>
#include <zlib.h>

#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "common/base/status.h"
#include "tests/town/depth_planes.h"

namespace panofix::town {
namespace {

namespace fs = std::filesystem;
using Eigen::Vector3d;

TownOptions Tiny() {
  TownOptions options;
  options.seed = 9;
  options.num_panoramas = 3;
  options.num_frames = 2;
  options.pano_width_px = 192;
  options.frame_width_px = 64;
  options.frame_height_px = 48;
  return options;
}

class TownFolder : public ::testing::Test {
 protected:
  TownFolder()
      : root_(fs::temp_directory_path() / ("panofix_town_test_" + std::to_string(getpid()))) {
    fs::create_directories(root_);
  }
  ~TownFolder() override {
    std::error_code ignored;
    fs::remove_all(root_, ignored);
  }
  fs::path root_;
};

std::string ReadAll(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

std::map<std::string, std::string> ReadTree(const fs::path& root) {
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(root)) {
    if (entry.is_regular_file())
      files[fs::relative(entry.path(), root).string()] = ReadAll(entry.path());
  }
  return files;
}

std::string FromBase64(const std::string& text) {
  std::string bytes;
  std::uint32_t group = 0;
  int bits = 0;
  for (const char c : text) {
    int value = -1;
    if (c >= 'A' && c <= 'Z') value = c - 'A';
    if (c >= 'a' && c <= 'z') value = c - 'a' + 26;
    if (c >= '0' && c <= '9') value = c - '0' + 52;
    if (c == '+' || c == '-') value = 62;
    if (c == '/' || c == '_') value = 63;
    if (value < 0) continue;
    group = group << 6 | static_cast<std::uint32_t>(value);
    bits += 6;
    if (bits >= 8) bytes.push_back(static_cast<char>(group >> (bits -= 8) & 255u));
  }
  return bytes;
}

PlaneDepth Decode(const std::string& text, bool zlib) {
  std::string bytes = FromBase64(text);
  if (zlib) {
    std::string raw(1 << 18, '\0');
    uLongf size = raw.size();
    EXPECT_EQ(uncompress(reinterpret_cast<Bytef*>(raw.data()), &size,
                         reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()),
              Z_OK);
    raw.resize(size);
    bytes = raw;
  }
  const auto byte = [&](std::size_t i) {
    return static_cast<unsigned>(static_cast<unsigned char>(bytes.at(i)));
  };
  EXPECT_EQ(byte(0), 8u);
  const std::size_t num_planes = byte(1) + 256 * byte(2);
  EXPECT_EQ(byte(3) + 256 * byte(4), 512u);
  EXPECT_EQ(byte(5) + 256 * byte(6), 256u);
  EXPECT_EQ(byte(7), 8u);
  EXPECT_EQ(bytes.size(), 8 + 512 * 256 + 16 * num_planes);
  PlaneDepth depth;
  for (std::size_t i = 0; i < 512 * 256; ++i)
    depth.indices.push_back(static_cast<std::uint8_t>(byte(8 + i)));
  for (std::size_t i = 0; i < num_planes; ++i) {
    float values[4];
    std::memcpy(values, bytes.data() + 8 + 512 * 256 + 16 * i, sizeof(values));
    depth.planes.push_back({Vector3d(static_cast<double>(values[0]), static_cast<double>(values[1]),
                                     static_cast<double>(values[2])),
                            static_cast<double>(values[3])});
  }
  return depth;
}

TEST(DepthPlanesTest, EveryFormHoldsTheExactPlaneRanges) {
  TownOptions options = Tiny();
  options.depth_noise_share = options.normal_noise_deg = 0;
  const Town town = Town::Generate(options);
  const Rigid3& pose = town.layout().panoramas[1].town_from_pano;
  const PlaneDepth seen = SeePlanes(town, pose, Rng(1, "depth"));
  EXPECT_GT(seen.planes.size(), 5u);
  for (const GsvForm form : {GsvForm{false, true, false}, GsvForm{true, true, true},
                             GsvForm{true, false, false}, GsvForm{false, false, true}}) {
    const std::string text = EncodeGsv(seen, form);
    EXPECT_EQ(text.find_first_of(form.url_safe ? "+/" : "-_"), std::string::npos);
    const PlaneDepth depth = Decode(text, form.zlib);
    ASSERT_EQ(depth.planes.size(), seen.planes.size());
    int surfaces = 0;
    for (int row = 1; row < 256; row += 9) {
      for (int column = 0; column < 512; column += 7) {
        const Vector3d ray = DepthPixelRay(column, row);
        const auto truth = town.PlaneRange(pose.translation, pose.rotation * ray);
        const std::size_t index = depth.indices[static_cast<std::size_t>(row * 512 + column)];
        ASSERT_EQ(index != 0, truth.has_value());
        if (index == 0) continue;
        ++surfaces;
        const double speed = depth.planes[index].normal.dot(ray);
        const double range = depth.planes[index].d / speed;
        // Single-precision planes: the error grows with the slant.
        EXPECT_NEAR(range, *truth, 1e-6 * (*truth / std::abs(speed) + 1) * 3);
        EXPECT_GT(range, 0);
      }
    }
    EXPECT_GT(surfaces, 1000);
  }
}

TEST(DepthPlanesTest, NoiseHasTheSigmaAskedFor) {
  TownOptions options = Tiny();
  options.normal_noise_deg = 0;
  const Town noisy = Town::Generate(options);
  options.depth_noise_share = 0;
  const Town exact = Town::Generate(options);
  double squares = 0;
  int count = 0;
  for (std::size_t i = 0; i < exact.layout().panoramas.size(); ++i) {
    const Rigid3& pose = exact.layout().panoramas[i].town_from_pano;
    const PlaneDepth a = SeePlanes(exact, pose, Rng(i, "depth")),
                     b = SeePlanes(noisy, pose, Rng(i, "depth"));
    ASSERT_EQ(a.indices, b.indices);
    for (std::size_t k = 1; k < a.planes.size(); ++k) {
      const double error = b.planes[k].d / a.planes[k].d - 1;
      squares += error * error;
      ++count;
    }
  }
  ASSERT_GT(count, 20);
  // Sigma from some dozens of draws: known to a quarter, with a margin of three.
  EXPECT_NEAR(std::sqrt(squares / count), 0.02, 0.012);
}

TEST_F(TownFolder, EqualArgumentsGiveEqualBytesForAnyThreadCount) {
  for (const std::size_t threads : {1u, 3u}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    WriteTown(Town::Generate(Tiny()), root_ / std::to_string(threads));
  }
  const auto one = ReadTree(root_ / "1"), three = ReadTree(root_ / "3");
  EXPECT_EQ(one.size(), 3u * 2 + 2 + 2 + 2 + 3);  // pictures and depth, lists, frames, summaries
  EXPECT_TRUE(one == three);
  TownOptions other = Tiny();
  other.seed = 10;
  WriteTown(Town::Generate(other), root_ / "other");
  const auto different = ReadTree(root_ / "other");
  for (const auto& [name, bytes] : one) {
    const bool from_seed =
        name.find("camera.yaml") == std::string::npos && name != "drive/frames.csv";
    if (from_seed) {
      EXPECT_NE(bytes, different.at(name)) << name;
    }
  }
}

std::vector<std::vector<std::string>> ReadCsv(const fs::path& path) {
  std::vector<std::vector<std::string>> rows;
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) {
    std::vector<std::string> cells;
    std::istringstream stream(line);
    for (std::string cell; std::getline(stream, cell, ',');) cells.push_back(cell);
    rows.push_back(cells);
  }
  return rows;
}

// Position and attitude of a truth row against a pose of the layout.
void ExpectPose(const Town& town, const std::vector<std::string>& row, const Vector3d& position,
                const Eigen::Matrix3d& town_from_body) {
  ASSERT_EQ(row.size(), 7u);
  const Geodetic at{std::stod(row[1]), std::stod(row[2]), std::stod(row[3])};
  const Attitude attitude{std::stod(row[4]), std::stod(row[5]), std::stod(row[6])};
  EXPECT_LT((town.geodesy().ToTown(at) - position).norm(), 2e-6);  // the altitude's last decimal
  EXPECT_LT((town.geodesy().TownFromBody(at, attitude) - town_from_body).norm(), 1e-9);
}

TEST_F(TownFolder, TruthIsExactAndTheWrittenGeotagsErr) {
  const Town town = Town::Generate(Tiny());
  WriteTown(town, root_);
  const auto panoramas = ReadCsv(root_ / "truth_panoramas.csv");
  ASSERT_EQ(panoramas.size(), 4u);
  const auto set = nlohmann::json::parse(ReadAll(root_ / "panoramas.geojson"));
  ASSERT_EQ(set["features"].size(), 3u);
  EXPECT_TRUE(set.contains("source") && set.contains("licence") && set.contains("height_datum"));
  for (std::size_t i = 0; i < 3; ++i) {
    const PanoramaPose& pose = town.layout().panoramas[i];
    EXPECT_EQ(panoramas[i + 1][0], pose.id);
    ExpectPose(town, panoramas[i + 1], pose.town_from_pano.translation,
               pose.town_from_pano.rotation.toRotationMatrix());
    const auto& feature = set["features"][i];
    const auto& at = feature["geometry"]["coordinates"];
    const Vector3d written = town.geodesy().ToTown({at[1], at[0], at[2]});
    const double error_m = (written - pose.town_from_pano.translation).norm();
    EXPECT_GT(error_m, 1e-4);
    EXPECT_LT(error_m, 6 * Tiny().geotag_noise_m);
    EXPECT_TRUE(fs::exists(root_ / feature["properties"]["image"].get<std::string>()));
    EXPECT_TRUE(fs::exists(root_ / feature["properties"]["depth"].get<std::string>()));
    EXPECT_EQ(feature["properties"]["links"].size(), i == 1 ? 2u : 1u);
  }
  const auto truth = ReadCsv(root_ / "drive" / "truth.csv"),
             frames = ReadCsv(root_ / "drive" / "frames.csv");
  ASSERT_EQ(truth.size(), 3u);
  for (std::size_t i = 0; i < 2; ++i) {
    const FramePose& frame = town.layout().frames[i];
    EXPECT_EQ(truth[i + 1][0], frames[i + 1][0]);
    EXPECT_TRUE(fs::exists(root_ / "drive" / frames[i + 1][1]));
    ExpectPose(town, truth[i + 1], frame.town_from_cam.translation,
               frame.town_from_cam.rotation.toRotationMatrix() * BodyFromCam().transpose());
  }
  const auto camera = ReadCameraYaml(root_ / "camera.yaml");
  ASSERT_TRUE(camera.ok());
  EXPECT_EQ(camera->fx_px, town.camera().fx_px);
}

TEST_F(TownFolder, WritesOverAnEarlierTownButNotOverStrangers) {
  TownOptions options = Tiny();
  options.num_panoramas = 2;
  options.write_drive = false;
  WriteTown(Town::Generate(Tiny()), root_ / "a");
  WriteTown(Town::Generate(options), root_ / "a");
  EXPECT_FALSE(fs::exists(root_ / "a" / "panoramas" / "pano-00002.jpg"));
  EXPECT_TRUE(fs::exists(root_ / "a" / "drive" / "images" / "000001.jpg"));
  fs::create_directories(root_ / "b");
  std::ofstream(root_ / "b" / "letters.txt") << "mine";
  EXPECT_THROW(PrepareFolder(root_ / "b", options), Error);
  EXPECT_TRUE(fs::exists(root_ / "b" / "letters.txt"));
}

}  // namespace
}  // namespace panofix::town
