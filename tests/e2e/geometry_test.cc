// With the town's noise off, what the builder derives is exact: depth of views, poses, points.
#include <gtest/gtest.h>

#include <algorithm>
#include <sstream>

#include "builder/ingest/panorama_set.h"
#include "builder/rectify/rectifier.h"
#include "common/map/map_bundle.h"
#include "tests/e2e/data_set.h"
#include "tests/e2e/truth.h"
#include "tests/town/town.h"

namespace panofix::e2e {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Planes are stored as float: relative error of a few 1e-6, more where a ray grazes its plane.
constexpr double kMedianDepthError = 1e-3;
// A view pixel within a depth pixel of an edge may be given the neighbour's plane.
constexpr double kExactShare = 0.95, kExactError = 1e-3;
// Attitudes and positions are written with 10 and 12 decimals of a degree, heights with 6 of a
// metre; the graph adds rounding alone.
constexpr double kAttitudeTolerance_deg = 1e-9, kPositionTolerance_deg = 1e-9;
constexpr double kHeightTolerance_m = 1e-5;
// Points are stored as float.
constexpr double kReprojection_px = 1e-2;

constexpr int kSeed = 11, kNumPanoramas = 3, kPanoWidth_px = 512;
constexpr int kFrameWidth_px = 200, kFrameHeight_px = 150;

town::Town MakeTown() {
  town::TownOptions options;
  options.seed = kSeed;
  options.num_panoramas = kNumPanoramas;
  options.pano_width_px = kPanoWidth_px;
  options.frame_width_px = kFrameWidth_px;
  options.frame_height_px = kFrameHeight_px;
  options.depth_noise_share = options.normal_noise_deg = 0;
  options.geotag_noise_m = options.heading_noise_deg = 0;
  return town::Town::Generate(options);
}

class Geometry : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    data_ = std::make_unique<TownData>(std::vector<std::string>{
        "--seed", std::to_string(kSeed), "--panoramas", std::to_string(kNumPanoramas),
        "--pano-width-px", std::to_string(kPanoWidth_px), "--frame-width-px",
        std::to_string(kFrameWidth_px), "--frame-height-px", std::to_string(kFrameHeight_px),
        "--no-drive", "--depth-noise-share", "0", "--normal-noise-deg", "0", "--geotag-noise-m",
        "0", "--heading-noise-deg", "0"});
    // What the default build merges and refines would no longer be exact.
    built_ = data_->Build(data_->panoramas(), data_->root() / "map", {"--preset", "paper"});
    town_ = std::make_unique<town::Town>(MakeTown());
  }
  static void TearDownTestSuite() {
    data_.reset();
    town_.reset();
  }
  void SetUp() override { ASSERT_EQ(built_.exit_code, 0) << built_.errors; }

  // The town's exact pose of a panorama; the layout is in the order of ids.
  static const Rigid3& TownFromPano(const std::string& id) {
    const auto& panoramas = town_->layout().panoramas;
    const auto found = std::find_if(panoramas.begin(), panoramas.end(),
                                    [&](const auto& pose) { return pose.id == id; });
    EXPECT_NE(found, panoramas.end()) << id;
    return found->town_from_pano;
  }
  static std::shared_ptr<const MapBundle> Open() {
    return MapBundle::Open(data_->root() / "map").value();
  }

  static inline std::unique_ptr<TownData> data_;
  static inline std::unique_ptr<town::Town> town_;
  static inline Outcome built_;
};

TEST_F(Geometry, DepthOfAViewIsThePlanesOwn) {
  const Camera camera = ReadCameraYaml(data_->camera()).value().WithoutDistortion();
  // Level views and a tilted ring: a swapped sign shows in the tilt.
  std::vector<ViewDirection> directions = RingOfViews(4, 0);
  for (const ViewDirection& tilted : RingOfViews(3, 15, 10)) directions.push_back(tilted);
  const Rectifier rectifier(camera, directions);
  const PanoramaSet set = ReadPanoramaSet(data_->panoramas()).value();
  ASSERT_EQ(set.panoramas.size(), static_cast<std::size_t>(kNumPanoramas));
  std::vector<double> errors;
  int num_sky_disagrees = 0, num_pixels = 0;
  for (const PanoramaRecord& record : set.panoramas) {
    const DepthMap depth = DepthMap::Read(record.depth, record.depth_scale_m).value();
    const Rigid3& town_from_pano = TownFromPano(record.id);
    for (std::size_t v = 0; v < directions.size(); ++v) {
      const std::vector<float> z_m = rectifier.CutDepth(depth, static_cast<int>(v));
      const Matrix3d pano_from_cam = PanoFromCam(directions[v]);
      for (int y = 2; y < kFrameHeight_px; y += 5) {
        for (int x = 2; x < kFrameWidth_px; x += 5) {
          const Eigen::Vector2d n = camera.Normalize({x, y});
          const Vector3d ray_in_cam = Vector3d(n.x(), n.y(), 1).normalized();
          const auto range_m = town_->PlaneRange(
              town_from_pano.translation, town_from_pano.rotation * (pano_from_cam * ray_in_cam));
          const auto cut = double{z_m[static_cast<std::size_t>(y * kFrameWidth_px + x)]};
          ++num_pixels;
          if (range_m.has_value() != (cut > 0)) {
            ++num_sky_disagrees;
          } else if (range_m) {
            errors.push_back(std::abs(cut / (*range_m * ray_in_cam.z()) - 1));
          }
        }
      }
    }
  }
  ASSERT_GT(errors.size(), 10'000U);
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[errors.size() / 2], kMedianDepthError);
  const auto num_exact =
      std::lower_bound(errors.begin(), errors.end(), kExactError) - errors.begin();
  EXPECT_GT(static_cast<double>(num_exact), kExactShare * static_cast<double>(errors.size()));
  EXPECT_LT(num_sky_disagrees, (1 - kExactShare) * num_pixels);
}

TEST_F(Geometry, DepthCommandAnswersTheTown) {
  const std::string id = town_->layout().panoramas[1].id;
  const std::vector<std::pair<int, int>> pixels{{256, 150}, {128, 130}, {384, 120}, {10, 200}};
  std::vector<std::string> arguments{
      "depth", (data_->town() / "panoramas" / (id + ".gsv")).string(), "--json"};
  for (const auto& [column, row] : pixels) {
    arguments.insert(arguments.end(),
                     {"--pixel", std::to_string(column) + "," + std::to_string(row)});
  }
  const Outcome outcome = Builder(arguments);
  ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  const Json report = Json::parse(outcome.output);
  ASSERT_EQ(report["pixels"].size(), pixels.size());
  const DepthMap depth = DepthMap::Read(arguments[1], 1).value();
  const Rigid3& town_from_pano = TownFromPano(id);
  int num_surfaces = 0;
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const Vector3d ray = depth.PixelRay(pixels[i].first, pixels[i].second);
    const auto range_m =
        town_->PlaneRange(town_from_pano.translation, town_from_pano.rotation * ray);
    ASSERT_EQ(range_m.has_value(), !report["pixels"][i]["range_m"].is_null());
    if (!range_m) continue;
    ++num_surfaces;
    EXPECT_NEAR(report["pixels"][i]["range_m"].get<double>() / *range_m, 1, kMedianDepthError);
  }
  EXPECT_GE(num_surfaces, 2);
}

// Rows of truth_panoramas.csv by id.
std::map<std::string, std::pair<Geodetic, Attitude>> ReadTruth(const std::filesystem::path& path) {
  std::map<std::string, std::pair<Geodetic, Attitude>> truth;
  std::istringstream text(ReadText(path));
  std::string line;
  std::getline(text, line);
  while (std::getline(text, line)) {
    const std::string id = line.substr(0, line.find(','));
    Geodetic at;
    Attitude a;
    EXPECT_EQ(std::sscanf(line.c_str() + id.size(), ",%lf,%lf,%lf,%lf,%lf,%lf", &at.lat_deg,
                          &at.lon_deg, &at.height_m, &a.heading_deg, &a.pitch_deg, &a.roll_deg),
              6);
    truth[id] = {at, a};
  }
  return truth;
}

TEST_F(Geometry, PosesComeThroughTheGraph) {
  const auto truth = ReadTruth(data_->town() / "truth_panoramas.csv");
  // A grid whose north is turned against true north by half a degree here, beside the bundle's own.
  const std::filesystem::path grid = data_->root() / "lambert93";
  ASSERT_EQ(
      data_->Build(data_->panoramas(), grid, {"--map-frame", "EPSG:2154", "--no-refine"}).exit_code,
      0);
  for (const auto& bundle : {Open(), MapBundle::Open(grid).value()}) {
    ASSERT_EQ(bundle->panoramas().size(), truth.size());
    for (const MapPanorama& panorama : bundle->panoramas()) {
      SCOPED_TRACE(panorama.id);
      const auto& [position, attitude] = truth.at(panorama.id);
      const Geodetic at = bundle->frame().ToGeodetic(panorama.map_from_pano.translation);
      EXPECT_NEAR(at.lat_deg, position.lat_deg, kPositionTolerance_deg);
      EXPECT_NEAR(at.lon_deg, position.lon_deg, kPositionTolerance_deg);
      EXPECT_NEAR(at.height_m, position.height_m, kHeightTolerance_m);
      const Matrix3d enu_from_map = bundle->frame().MapFromEnu(at).transpose();
      const Attitude a =
          AttitudeFromEnu(enu_from_map * panorama.map_from_pano.rotation.toRotationMatrix());
      EXPECT_NEAR(AngleDifferenceDeg(a.heading_deg, attitude.heading_deg), 0,
                  kAttitudeTolerance_deg);
      EXPECT_NEAR(a.pitch_deg, attitude.pitch_deg, kAttitudeTolerance_deg);
      EXPECT_NEAR(a.roll_deg, attitude.roll_deg, kAttitudeTolerance_deg);
    }
  }
}

TEST_F(Geometry, LandmarksLieOnTheTownInTheirViews) {
  const auto bundle = Open();
  const Camera camera = bundle->manifest().camera.WithoutDistortion();
  std::size_t num_points = 0, num_exact = 0;
  for (std::size_t v = 0; v < bundle->views().size(); ++v) {
    const MapView& view = bundle->views()[v];
    const MapPanorama& panorama = bundle->panoramas()[view.panorama_idx];
    const Rigid3& town_from_pano = TownFromPano(panorama.id);
    const Matrix3d cam_from_pano = PanoFromCam({view.yaw_deg, view.pitch_deg}).transpose();
    const MapBundle::LandmarkList landmarks = bundle->LandmarksOf(v);
    for (std::size_t i = 0; i < landmarks.size(); ++i) {
      const MapLandmark landmark = bundle->Landmark(landmarks[i]);
      ASSERT_EQ(landmark.panorama_idx, view.panorama_idx);
      const Vector3d& x_in_pano = landmark.point_in_pano;
      const auto px = camera.Project(cam_from_pano * x_in_pano);
      ASSERT_TRUE(px);
      EXPECT_GE(px->x(), -0.5 - kReprojection_px);
      EXPECT_LE(px->x(), kFrameWidth_px - 0.5 + kReprojection_px);
      EXPECT_GE(px->y(), -0.5 - kReprojection_px);
      EXPECT_LE(px->y(), kFrameHeight_px - 0.5 + kReprojection_px);
      const auto range_m = town_->PlaneRange(town_from_pano.translation,
                                             town_from_pano.rotation * x_in_pano.normalized());
      ++num_points;
      if (range_m && std::abs(x_in_pano.norm() / *range_m - 1) < kExactError) ++num_exact;
    }
  }
  ASSERT_GT(num_points, 500U);
  // Keypoints like edges, where the depth pixel decides the plane.
  constexpr double kShareAtKeypoints = 0.85;
  EXPECT_GT(static_cast<double>(num_exact), kShareAtKeypoints * static_cast<double>(num_points));
}

TEST_F(Geometry, LandmarksHaveTheWordsOfTheirDescriptors) {
  const auto bundle = Open();
  for (std::size_t t = 0; t < bundle->tiles().size(); ++t) {
    const MapTile& tile = bundle->tiles().Get(t);
    ASSERT_GT(tile.num_landmarks(), 100U);
    const std::vector<std::uint32_t> derived = tile.DeriveWords(bundle->vocabulary().sift);
    EXPECT_TRUE(
        std::equal(derived.begin(), derived.end(), tile.words().begin(), tile.words().end()));
  }
}

}  // namespace
}  // namespace panofix::e2e
