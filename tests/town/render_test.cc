// Pictures agree with the pixel conventions that everything downstream relies on.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <numbers>

#include "common/base/rng.h"
#include "common/geometry/attitude.h"
#include "tests/town/camera_effects.h"
#include "tests/town/textures.h"
#include "tests/town/writer.h"

namespace panofix::town {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// Centroid of one small marker: sixteen samples an edge pixel leave 0.03 px rms; its mean over many
// markers has no such excuse and shows a shifted grid.
constexpr double kCentroid_px = 0.1;
constexpr double kMeanShift_px = 0.015;

Light Flat() {
  Light light;
  light.sun = {0, 0, 0};
  light.sky = {1, 1, 1};
  return light;
}

// A bright square facing the origin at `centre`, before a dark dome of six walls. Hundreds of
// metres away, so that the grain of its surface has faded.
World MarkerWorld(const Vector3d& centre) {
  World world;
  Material bright, dark;
  bright.a = {4, 4, 4};
  dark.a = {0, 0, 0};
  const auto bright_idx = world.AddMaterial(bright), dark_idx = world.AddMaterial(dark);
  const Vector3d w = -centre.normalized(), u = Vector3d::UnitZ().cross(w).normalized(),
                 v = w.cross(u);
  const double s = 0.02 * centre.norm();
  world.AddQuad(centre - s * u - s * v, centre + s * u - s * v, centre + s * u + s * v,
                centre - s * u + s * v, bright_idx);
  const double r = 2000;
  world.AddBox({-r, -r, -r}, {2 * r, 0, 0}, {0, 2 * r, 0}, {0, 0, 2 * r}, dark_idx);
  world.AddQuad({-r, -r, -r}, {-r, r, -r}, {r, r, -r}, {r, -r, -r}, dark_idx);
  return world;
}

Vector2d Centroid(const std::vector<Rgb>& pixels, int width) {
  double sum = 0;
  Vector2d at(0, 0);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const double weight = static_cast<double>(pixels[i].g);
    sum += weight;
    at += weight * Vector2d(static_cast<double>(i % static_cast<std::size_t>(width)),
                            static_cast<double>(i / static_cast<std::size_t>(width)));
  }
  return at / sum;
}

TEST(RendererTest, PanoramaPixelsFollowTheContract) {
  constexpr int kWidth = 512;
  const Rigid3 town_from_pano(EnuFromBody({35, 4, -3}), Vector3d::Zero());
  Rng rng(4, "markers");
  Vector2d shift(0, 0);
  constexpr int kMarkers = 24;
  for (int i = 0; i < kMarkers; ++i) {
    // Away from the seam behind, where a marker would be cut in two.
    const double azimuth = rng.Uniform(-2.9, 2.9), elevation = rng.Uniform(-0.5, 0.5);
    const Vector3d ray(std::cos(elevation) * std::sin(azimuth),
                       std::cos(elevation) * std::cos(azimuth), std::sin(elevation));
    const World world = MarkerWorld(town_from_pano * (600.0 * ray));
    const Renderer renderer(world, Flat(), 16);
    std::vector<Rgb> pixels(kWidth * kWidth / 2);
    renderer.PanoramaRows(town_from_pano, kWidth, 0, kWidth / 2, pixels.data());
    // The contract inverted: column 0 is heading - 180 degrees, row 0 the zenith, centres at + 0.5.
    const Vector2d expected((azimuth / (2 * std::numbers::pi) + 0.5) * kWidth - 0.5,
                            (0.5 - elevation / std::numbers::pi) * (kWidth / 2) - 0.5);
    const Vector2d error = Centroid(pixels, kWidth) - expected;
    EXPECT_LT(error.norm(), kCentroid_px);
    shift += error / kMarkers;
  }
  EXPECT_LT(shift.norm(), kMeanShift_px);
}

TEST(RendererTest, FramesDrawPointsWhereTheCameraProjectsThem) {
  Camera camera = Camera::FromHorizontalFov(320, 240, 70);
  for (const bool distorted : {false, true}) {
    if (distorted) camera.distortion = {-0.25, 0.06, 0.002, -0.001, 0.01, 0, 0, 0};
    const Rigid3 town_from_cam(Eigen::Matrix3d(EnuFromBody({-100, 5, 2}) * BodyFromCam()),
                               {1, 2, 3});
    for (const Vector3d& x_in_cam :
         {Vector3d(10, -20, 500), Vector3d(-220, 140, 600), Vector3d(250, 150, 700)}) {
      World world = MarkerWorld(town_from_cam * x_in_cam);
      const Renderer renderer(world, Flat(), 16);
      const LinearImage image = renderer.Frame(town_from_cam, camera);
      const auto expected = camera.Project(x_in_cam);
      ASSERT_TRUE(expected.has_value());
      EXPECT_LT((Centroid(image.pixels, image.width) - *expected).norm(), kCentroid_px);
    }
  }
}

TEST(RendererTest, StripsMakeOnePicture) {
  TownOptions options;
  options.num_panoramas = 2;
  options.num_frames = 0;
  const Town town = Town::Generate(options);
  const Rigid3& pose = town.layout().panoramas[0].town_from_pano;
  constexpr int kWidth = 128, kRows = kWidth / 2;
  std::vector<Rgb> whole(kWidth * kRows), strips(kWidth * kRows);
  town.renderer(Day::kMap).PanoramaRows(pose, kWidth, 0, kRows, whole.data());
  for (int row = 0; row < kRows; row += 16) {
    town.renderer(Day::kMap).PanoramaRows(pose, kWidth, row, row + 16,
                                          strips.data() + kWidth * row);
  }
  int differing = 0;
  for (std::size_t i = 0; i < whole.size(); ++i) {
    differing += std::abs(whole[i].g - strips[i].g) > 1e-3f;
  }
  // A ray along an edge may fall either way when packets are grouped differently.
  EXPECT_LE(differing, 4);
}

TEST(RendererTest, TheSunCastsShadows) {
  World world;
  Material white;
  white.a = {0.8f, 0.8f, 0.8f};
  const auto idx = world.AddMaterial(white);
  world.AddQuad({-20, -20, 0}, {20, -20, 0}, {20, 20, 0}, {-20, 20, 0}, idx);
  world.AddBox({2, -3, 1}, {1, 0, 0}, {0, 6, 0}, {0, 0, 1}, idx);
  Light light = Flat();
  light.sun = {2, 2, 2};
  light.sky = {0.2f, 0.2f, 0.2f};
  light.to_sun = Eigen::Vector3f(1, 0, 1).normalized();
  const Renderer renderer(world, light, 1);
  // Looking straight down from above the shadow's middle: box x 2..3, z 1..2 falls on x 0..2.
  Eigen::Matrix3d cam;
  cam.col(0) = Vector3d::UnitX(), cam.col(1) = -Vector3d::UnitY(), cam.col(2) = -Vector3d::UnitZ();
  const Camera camera = Camera::FromHorizontalFov(64, 64, 120);
  const LinearImage image = renderer.Frame(Rigid3(cam, Vector3d(0, 0, 4)), camera);
  const auto at = [&](const Vector3d& x) {
    const auto px = camera.Project(cam.transpose() * (x - Vector3d(0, 0, 4)));
    return image
        .pixels[static_cast<std::size_t>(std::lround(px->y())) * 64 +
                static_cast<std::size_t>(std::lround(px->x()))]
        .g;
  };
  EXPECT_GT(at({-1, 0, 0}), 3 * at({1, 0, 0}));
}

TEST(TextureTest, FarAwayDetailFadesInsteadOfFlickering) {
  WallStyle style;
  style.upper.pattern = WallPattern::kBrick;
  style.upper.unit_width_m = 0.22f, style.upper.unit_height_m = 0.07f;
  style.upper.stain = 0;
  const auto spread = [&](float footprint) {
    double sum = 0, squares = 0;
    constexpr int kCount = 400;
    for (int i = 0; i < kCount; ++i) {
      const auto step = static_cast<float>(i);
      const double g = static_cast<double>(
          WallColour(style, 9, 0.0371f * step, 3 + 0.0533f * step, {footprint, footprint}).g);
      sum += g, squares += g * g;
    }
    return std::sqrt(std::max(0.0, squares / kCount - sum * sum / kCount / kCount)) /
           (sum / kCount);
  };
  EXPECT_GT(spread(0.005f), 0.1);
  EXPECT_LT(spread(1.0f), 0.25 * spread(0.005f));
}

TEST(TextureTest, PulsesAreExactAverages) {
  // Oracle: a fine Riemann sum of the unfiltered train.
  for (const float w : {0.01f, 0.13f, 0.7f, 3.0f}) {
    for (const float x : {-1.3f, 0.0f, 0.27f, 5.5f}) {
      constexpr int kSteps = 20000;
      int inside = 0;
      for (int i = 0; i < kSteps; ++i) {
        const double at =
            static_cast<double>(x) + static_cast<double>(w) * ((i + 0.5) / kSteps - 0.5);
        inside += at - std::floor(at / 0.3) * 0.3 < 0.1;
      }
      EXPECT_NEAR(static_cast<double>(Pulses(x, 0.3f, 0.1f, w)),
                  static_cast<double>(inside) / kSteps, 2e-3);
    }
  }
}

TEST(CameraEffectsTest, ExposureBrightensAndNoiseIsReproducible) {
  LinearImage image{16, 16, std::vector<Rgb>(256, Rgb{0.05f, 0.05f, 0.05f})};
  EXPECT_NEAR(static_cast<double>(AutoExposure(image)), 4.0, 1e-6);  // at the limit
  CameraEffects effects;
  effects.read_noise = 0.01f;
  effects.exposure = 2;
  std::vector<std::uint8_t> a(768), b(768), brighter(768);
  Develop(image.pixels.data(), 16, 16, 0, 16, effects, a.data());
  Develop(image.pixels.data(), 16, 16, 0, 16, effects, b.data());
  effects.exposure = 4;
  Develop(image.pixels.data(), 16, 16, 0, 16, effects, brighter.data());
  EXPECT_EQ(a, b);
  double mean_a = 0, mean_brighter = 0;
  for (std::size_t i = 0; i < a.size(); ++i) mean_a += a[i], mean_brighter += brighter[i];
  EXPECT_GT(mean_brighter, 1.2 * mean_a);
}

TEST(CameraEffectsTest, BlurKeepsTheLight) {
  LinearImage image{33, 33, std::vector<Rgb>(33 * 33)};
  image.pixels[16 * 33 + 16] = {1, 1, 1};
  CameraEffects effects;
  effects.defocus_sigma_px = 1.2f;
  effects.motion_px = 3;
  Blur(image, effects);
  double sum = 0;
  for (const Rgb& p : image.pixels) sum += static_cast<double>(p.g);
  EXPECT_NEAR(sum, 1, 1e-4);
  EXPECT_LT(image.pixels[16 * 33 + 16].g, 0.3f);
  const Vector2d centre = Centroid(image.pixels, 33);
  EXPECT_LT((centre - Vector2d(16, 16)).norm(), 1e-3);
}

}  // namespace
}  // namespace panofix::town
