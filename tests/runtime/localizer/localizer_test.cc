#include "runtime/localizer/localizer.h"

#include <gtest/gtest.h>

#include <future>

#include "common/base/rng.h"
#include "common/geometry/attitude.h"
#include "common/map/map_bundle.h"
#include "runtime/retrieval/tile_indices.h"
#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"

namespace panofix {
namespace {

class LocalizerTest : public testing::Test {
 protected:
  LocalizerTest() {
    CraftedBundle bundle = SmallBundle();
    bundle.Write(folder_ / "map");
    camera_ = bundle.manifest.camera;
  }
  [[nodiscard]] std::unique_ptr<Localizer> Open() const {
    auto opened = Localizer::Open(folder_ / "map", camera_, {});
    EXPECT_TRUE(opened.ok()) << opened.status().message();
    return opened.ok() ? std::move(opened).value() : nullptr;
  }
  [[nodiscard]] GrayImage Image(std::uint8_t value) const {
    return {camera_.width_px, camera_.height_px,
            std::vector<std::uint8_t>(
                static_cast<std::size_t>(camera_.width_px * camera_.height_px), value)};
  }
  [[nodiscard]] GrayImage Noise() const {
    GrayImage noise = Image(0);
    Rng rng(1, "tests/localizer");
    for (auto& pixel : noise.pixels) pixel = static_cast<std::uint8_t>(rng.Below(256));
    return noise;
  }
  TempFolder folder_;
  Camera camera_;
};

TEST_F(LocalizerTest, SaysWhatItsBundleIs) {
  const auto localizer = Open();
  ASSERT_TRUE(localizer);
  EXPECT_EQ(localizer->bundle().num_panoramas, 4U);
  EXPECT_EQ(localizer->bundle().num_views, 10U);
  EXPECT_EQ(localizer->bundle().id.size(), 64U);
  EXPECT_FALSE(localizer->bundle().is_signed);
  const auto camera = Localizer::ReadBundleCamera(folder_ / "map");
  ASSERT_TRUE(camera.ok());
  EXPECT_EQ(camera->width_px, camera_.width_px);
}

TEST_F(LocalizerTest, BlackAndOverexposedFramesAreNoFixWithTheirReason) {
  const auto localizer = Open();
  ASSERT_TRUE(localizer);
  for (const std::uint8_t value : {std::uint8_t{0}, std::uint8_t{255}}) {
    const FrameResult result = localizer->Localize(17, Image(value));
    EXPECT_EQ(result.timestamp_ns, 17);
    EXPECT_EQ(result.status, FixStatus::kNoFix);
    EXPECT_EQ(result.reason, "too_few_features");
    EXPECT_FALSE(result.pose);
  }
}

TEST_F(LocalizerTest, NoiseIsNoPlace) {
  const auto localizer = Open();
  ASSERT_TRUE(localizer);
  const GrayImage noise = Noise();
  const FrameResult result = localizer->Localize(1, noise);
  EXPECT_EQ(result.status, FixStatus::kNoFix);
  EXPECT_FALSE(result.reason.empty());
  EXPECT_LE(result.num_compared, result.num_database);
}

TEST_F(LocalizerTest, FramesOfAnotherSizeAreSaid) {
  const auto localizer = Open();
  ASSERT_TRUE(localizer);
  for (const GrayImage& frame : {GrayImage{}, GrayImage{4, 4, std::vector<std::uint8_t>(16)}}) {
    EXPECT_EQ(localizer->Localize(1, frame).reason, "frame_size_differs_from_camera");
  }
  EXPECT_EQ(localizer->Undecodable(5).reason, "frame_undecodable");
  EXPECT_EQ(localizer->Undecodable(5).timestamp_ns, 5);
}

TEST_F(LocalizerTest, AnotherOverTheSameMapReadsNothingAgain) {
  const auto localizer = Open();
  ASSERT_TRUE(localizer);
  const TileMemory before = localizer->memory();
  auto another = localizer->Another();
  ASSERT_TRUE(another.ok()) << another.status().message();
  EXPECT_EQ(&(*another)->map(), &localizer->map());
  EXPECT_EQ((*another)->bundle().id, localizer->bundle().id);
  EXPECT_EQ((*another)->Localize(1, Image(0)).reason, "too_few_features");
  EXPECT_EQ((*another)->memory().num_loads, before.num_loads);
  EXPECT_EQ((*another)->memory().num_bytes, before.num_bytes);
}

// At the same time where tiles stay. With so little memory that every tile is read again for each
// search, they take turns, step by step.
TEST_F(LocalizerTest, TwoOverOneMapAnswerAsOneDoesWhateverTheMemory) {
  constexpr int kFrames = 10;
  const GrayImage noise = Noise();
  const FrameResult expected = Open()->Localize(0, noise);
  const auto num_equal = [&](Localizer* one) {
    int num = 0;
    for (int frame = 0; frame < kFrames; ++frame) {
      one->Forget();
      const FrameResult result = one->Localize(frame, noise, [] { return false; });
      num += result.reason == expected.reason && result.num_inliers == expected.num_inliers;
    }
    return num;
  };
  for (const std::uint64_t max_memory_bytes : {0, 1}) {
    LocalizerOptions options;
    options.max_memory_bytes = max_memory_bytes;
    const auto localizer = ValueOrThrow(Localizer::Open(folder_ / "map", camera_, options));
    const std::int64_t num_loads = localizer->memory().num_loads;
    const auto another = ValueOrThrow(localizer->Another());
    auto beside = std::async(std::launch::async, [&] { return num_equal(another.get()); });
    EXPECT_EQ(num_equal(localizer.get()), kFrames);
    EXPECT_EQ(beside.get(), kFrames);
    const std::int64_t num_again = localizer->memory().num_loads - num_loads;
    if (max_memory_bytes == 0) {
      EXPECT_EQ(num_again, 0);
    } else {
      EXPECT_GE(num_again, 2 * kFrames) << "no tile was dropped: this shows nothing";
    }
  }
}

TEST_F(LocalizerTest, FaultsAtOpeningHaveTheirCode) {
  const auto code_of = [](const auto& result) { return result.status().code(); };
  EXPECT_EQ(code_of(Localizer::Open(folder_ / "none", camera_, {})), ErrorCode::kNotFound);
  EXPECT_EQ(code_of(Localizer::Open(folder_ / "map", Camera{}, {})), ErrorCode::kInvalidArgument);
  LocalizerOptions options;
  options.preset = "fastest";
  EXPECT_EQ(code_of(Localizer::Open(folder_ / "map", camera_, options)),
            ErrorCode::kInvalidArgument);
  options.preset = "paper";
  options.add = {"luck"};
  EXPECT_EQ(code_of(Localizer::Open(folder_ / "map", camera_, options)),
            ErrorCode::kInvalidArgument);
}

TEST_F(LocalizerTest, ThePaperNeedsAMapWithImagesUnlessItsMatchesAreTakenAsTheyCome) {
  LocalizerOptions options;
  options.preset = "paper";
  const Status status = Localizer::Open(folder_ / "map", camera_, options).status();
  EXPECT_EQ(status.code(), ErrorCode::kInvalidArgument);
  EXPECT_NE(status.message().find("--keep-view-images"), std::string::npos) << status.message();
  options.add = {"mutual"};
  auto localizer = Localizer::Open(folder_ / "map", camera_, options);
  ASSERT_TRUE(localizer.ok()) << localizer.status().message();
  const GrayImage noise = Noise();
  for (int frame = 0; frame < 2; ++frame) {
    const FrameResult result = (*localizer)->Localize(frame, noise);
    EXPECT_EQ(result.status, FixStatus::kNoFix);
    EXPECT_EQ(result.reason, "no_consensus");
    EXPECT_GT(result.num_compared, 0);
  }
}

TEST(SigmasOf, TurnsTheGridsAxesToEastAndNorth) {
  constexpr double kTolerance = 1e-12;
  FramePose pose;
  // The grid's x axis points north: a quarter turn of convergence.
  pose.map_from_cam = Eigen::Quaterniond::Identity();
  pose.enu_from_cam =
      Eigen::Quaterniond(Eigen::AngleAxisd(90 * kRadPerDeg, Eigen::Vector3d::UnitZ()));
  pose.covariance_in_map.setZero();
  pose.covariance_in_map.diagonal() << 4, 9, 16, 0, 0, kRadPerDeg * kRadPerDeg;
  const PoseSigmas sigmas = SigmasOf(pose);
  EXPECT_NEAR(sigmas.north_m, 2, kTolerance);
  EXPECT_NEAR(sigmas.east_m, 3, kTolerance);
  EXPECT_NEAR(sigmas.up_m, 4, kTolerance);
  EXPECT_NEAR(sigmas.heading_deg, 1, kTolerance);
  pose.covariance_in_map(0, 0) = -1e-18;
  EXPECT_EQ(SigmasOf(pose).north_m, 0);
}

}  // namespace
}  // namespace panofix
