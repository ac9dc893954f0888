#include "builder/pipeline/landmark_stage.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "common/base/rng.h"
#include "common/geometry/attitude.h"
#include "tests/support/matchers.h"

namespace panofix {
namespace {

constexpr double kSpacing_m = 8, kWall_m = 7, kRange_m = 13, kFocal_px = 500;

// RootSIFT-like: 512 long, few large entries.
std::array<std::uint8_t, kDescriptorSize> RandomRootSift(Rng* rng) {
  std::array<double, kDescriptorSize> values;
  double sum_sq = 0;
  for (double& v : values) v = std::pow(rng->Uniform(), 4), sum_sq += v * v;
  std::array<std::uint8_t, kDescriptorSize> bytes;
  for (std::size_t i = 0; i < kDescriptorSize; ++i)
    bytes[i] = static_cast<std::uint8_t>(std::min(255.0, 512 * values[i] / std::sqrt(sum_sq)));
  return bytes;
}

// Panoramas every 8 m along y between two walls, each with a virtual station 4 m on that is
// rendered from it; a view to each side, which shows the wall's points within 13 m of its
// panorama. Geotags err, points and planes are exact.
class Row {
 public:
  explicit Row(std::uint32_t num_panoramas, double position_sigma_m = 0) {
    Rng rng(1, "tests/row");
    const MapFrame frame = *MapFrame::FromName("EPSG:2154");
    const LocalFrame street{frame.ToMap({46.5, 3.2, 30}), frame.PointScale({46.5, 3.2, 30})};
    content_.manifest.map_frame = frame.parameters();
    content_.directions = {{-90, 0}, {90, 0}};
    for (std::uint32_t p = 0; p < num_panoramas; ++p) {
      MapPanorama panorama;
      panorama.id = "p" + std::to_string(100 + p);
      panorama.point_scale = street.point_scale;
      const Eigen::Vector3d at(0, kSpacing_m * p, 0);
      truth_.push_back({Eigen::Quaterniond::Identity(), street.ToMap(at)});
      panorama.map_from_pano = truth_.back();
      for (int k = 0; k < 2; ++k)
        panorama.map_from_pano.translation[k] += position_sigma_m * rng.Normal();
      content_.panoramas.push_back(panorama);
      content_.stations.push_back({p, Eigen::Vector3d::Zero()});
      content_.stations.push_back({p, {0, 0.5 * kSpacing_m, 0}});
    }
    for (std::uint32_t i = 0; i < 40 * num_panoramas; ++i) {
      Point point;
      point.wall = 1 + i % 2;
      point.at = {point.wall == 1 ? -kWall_m : kWall_m,
                  rng.Uniform(-kRange_m, kSpacing_m * num_panoramas + kRange_m),
                  rng.Uniform(-2, 5)};
      point.size_m = static_cast<float>(rng.Uniform(0.1, 0.4));
      point.angle_deg = static_cast<float>(rng.Uniform(0, 360));
      point.descriptor = RandomRootSift(&rng);
      points_.push_back(point);
    }
  }

  // Native features of a panorama, or those rendered from it at its station.
  [[nodiscard]] PanoramaFeatures Features(std::size_t p, bool is_rendered) const {
    Rng rng(p, is_rendered ? "tests/rendered" : "tests/native");
    PanoramaFeatures features;
    features.sources = {content_.panoramas[p].id};
    features.has_depth = true;
    features.planes = {{{0, 0, 0}, 0}, {{-1, 0, 0}, float{kWall_m}}, {{1, 0, 0}, float{kWall_m}}};
    features.views.resize(2);
    const Eigen::Vector3d pano(0, kSpacing_m * static_cast<double>(p), 0);
    const Eigen::Vector3d station =
        pano + Eigen::Vector3d(0, is_rendered ? 0.5 * kSpacing_m : 0, 0);
    for (const Point& point : points_) {
      const Eigen::Vector3d x_in_pano = point.at - pano;
      if (x_in_pano.norm() > kRange_m) continue;
      ViewFeatureSet& view = features.views[point.wall - 1];
      const auto size_px =
          static_cast<float>(kFocal_px * double{point.size_m} / (point.at - station).norm());
      view.sift.keypoints.push_back({0, 0, size_px, point.angle_deg, 0.05F});
      for (const std::uint8_t byte : point.descriptor) {
        view.sift.descriptors.push_back(
            static_cast<std::uint8_t>(std::clamp(byte + 4 * rng.Normal(), 0.0, 255.0)));
      }
      view.points.push_back(
          {x_in_pano.cast<float>(), 0.3F, static_cast<std::uint8_t>(point.wall), 0});
    }
    return features;
  }

  BundleTile Make(std::size_t begin, std::size_t end, const LandmarkOptions& options, double halo_m,
                  std::vector<MapPanorama>* panoramas,
                  std::vector<RefinementReport>* report) const {
    Camera camera;
    camera.fx_px = camera.fy_px = kFocal_px;
    const LandmarkStageInput input{[this](std::size_t p) { return Features(p, false); },
                                   [this](std::size_t p) { return Features(p, true); },
                                   content_,
                                   {},
                                   camera,
                                   options,
                                   halo_m};
    return MakeLandmarkTile(input, begin, end, panoramas, report);
  }
  BundleTile Make(std::size_t begin, std::size_t end, const LandmarkOptions& options = {},
                  double halo_m = 45) const {
    std::vector<MapPanorama> panoramas = content_.panoramas;
    std::vector<RefinementReport> report;
    return Make(begin, end, options, halo_m, &panoramas, &report);
  }
  [[nodiscard]] const BundleContent& content() const { return content_; }
  [[nodiscard]] const std::vector<Rigid3>& truth() const { return truth_; }

 private:
  struct Point {
    Eigen::Vector3d at;
    std::size_t wall = 1;
    float size_m = 0, angle_deg = 0;
    std::array<std::uint8_t, kDescriptorSize> descriptor{};
  };
  BundleContent content_;
  std::vector<Rigid3> truth_;
  std::vector<Point> points_;
};

// The views of panoramas [begin, end).
bool IsOfTile(std::uint32_t view, std::size_t begin, std::size_t end) {
  return view >= 4 * begin && view < 4 * end;
}

TEST(LandmarkStage, TilesHoldWhatTheirViewsShow) {
  const Row row(12);
  const BundleTile tile = row.Make(4, 8);
  EXPECT_GT(tile.landmarks.size(), 100U);
  EXPECT_TRUE(std::is_sorted(tile.landmarks.begin(), tile.landmarks.end(),
                             [](const auto& a, const auto& b) { return a.panorama < b.panorama; }));
  std::set<std::uint32_t> anchors, views;
  int num_across = 0;
  for (const Landmark& landmark : tile.landmarks) {
    anchors.insert(landmark.panorama);
    ASSERT_FALSE(landmark.views.empty());
    EXPECT_TRUE(std::is_sorted(landmark.views.begin(), landmark.views.end()));
    for (const std::uint32_t view : landmark.views) {
      EXPECT_TRUE(IsOfTile(view, 4, 8)) << view;
      // One side's views show one side's wall.
      EXPECT_EQ(view % 2, landmark.point_in_pano.x() > 0 ? 1U : 0U);
    }
    views.insert(landmark.views.begin(), landmark.views.end());
    num_across += landmark.panorama < 4 || landmark.panorama >= 8 ? 1 : 0;
  }
  EXPECT_EQ(views.size(), 16U);  // native and rendered
  EXPECT_GT(num_across, 0);      // anchored beyond the border
  ASSERT_EQ(tile.anchors.size(), anchors.size());
  auto expected = anchors.begin();
  for (const BundleTile::Anchor& anchor : tile.anchors) {
    EXPECT_EQ(anchor.panorama_idx, *expected++);
    EXPECT_EQ(anchor.planes.size(), 3U);
    EXPECT_EQ(anchor.distance_sigma_share.size(), 3U);
    EXPECT_EQ(anchor.normal_sigma_rad.size(), 3U);
  }
}

// A landmark by what does not depend on the tile: its descriptor.
std::map<std::array<std::uint8_t, kDescriptorSize>, const Landmark*> ByDescriptor(
    const BundleTile& tile) {
  std::map<std::array<std::uint8_t, kDescriptorSize>, const Landmark*> result;
  for (const Landmark& landmark : tile.landmarks) result[landmark.descriptor] = &landmark;
  return result;
}

TEST(LandmarkStage, ATileCutInTwoHasTheSameLandmarks) {
  const Row row(14);
  LandmarkOptions options;
  options.refine = false;  // exactly so where nothing is moved
  constexpr double kHalo_m = 30;
  const auto whole_tile = row.Make(0, 14, options, kHalo_m);
  const auto whole = ByDescriptor(whole_tile);
  for (const auto& [begin, end] : {std::pair<std::size_t, std::size_t>{0, 7}, {7, 14}}) {
    const auto part_tile = row.Make(begin, end, options, kHalo_m);
    const auto part = ByDescriptor(part_tile);
    std::size_t num_compared = 0;
    for (const auto& [descriptor, landmark] : whole) {
      std::vector<std::uint32_t> views = landmark->views;
      std::erase_if(views, [&, b = begin, e = end](auto v) { return !IsOfTile(v, b, e); });
      if (views.empty()) continue;
      const auto found = part.find(descriptor);
      ASSERT_NE(found, part.end()) << "shown by view " << views.front();
      EXPECT_EQ(found->second->panorama, landmark->panorama);
      EXPECT_EQ(found->second->point_in_pano, landmark->point_in_pano);
      EXPECT_EQ(found->second->num_panoramas, landmark->num_panoramas);
      EXPECT_EQ(found->second->views, views);
      ++num_compared;
    }
    EXPECT_EQ(part.size(), num_compared);
    EXPECT_GT(num_compared, 150U);
  }
}

TEST(LandmarkStage, PosesAreRefinedAndReported) {
  const Row row(8, 0.05);
  std::vector<MapPanorama> panoramas = row.content().panoramas;
  std::vector<RefinementReport> report;
  (void)row.Make(0, 8, {}, 45, &panoramas, &report);
  ASSERT_EQ(report.size(), 8U);
  // A common shift is no error that neighbours could see: compared are steps between panoramas.
  double before_sq = 0, after_sq = 0;
  for (std::size_t p = 0; p < 8; ++p) {
    const MapPanorama& given = row.content().panoramas[p];
    EXPECT_EQ(report[p].id, given.id);
    EXPECT_GT(report[p].num_tracks, 10);
    EXPECT_FALSE(report[p].is_flagged);
    EXPECT_FALSE(panoramas[p].is_flagged);
    EXPECT_LT(report[p].residual_after_px, report[p].residual_before_px);
    const Eigen::Vector3d moved =
        panoramas[p].map_from_pano.translation - given.map_from_pano.translation;
    EXPECT_NEAR(report[p].shift_m, moved.norm(), 1e-3);  // grid against ground lengths
    if (p == 0) continue;
    const auto step_off = [&](const std::vector<MapPanorama>& poses) {
      const auto at = [&](std::size_t i) -> Eigen::Vector3d {
        return poses[i].map_from_pano.translation - row.truth()[i].translation;
      };
      return (at(p) - at(p - 1)).squaredNorm();
    };
    before_sq += step_off(row.content().panoramas);
    after_sq += step_off(panoramas);
  }
  EXPECT_LT(after_sq, before_sq / 4);  // half
}

// The halo's panoramas help and stay.
TEST(LandmarkStage, OnlyTheTilesOwnPanoramasMove) {
  const Row row(10, 0.05);
  std::vector<MapPanorama> panoramas = row.content().panoramas;
  std::vector<RefinementReport> report;
  (void)row.Make(3, 6, {}, 45, &panoramas, &report);
  ASSERT_EQ(report.size(), 3U);
  for (std::size_t p = 0; p < 10; ++p) {
    const bool is_own = p >= 3 && p < 6;
    EXPECT_EQ(panoramas[p].map_from_pano.translation !=
                  row.content().panoramas[p].map_from_pano.translation,
              is_own)
        << p;
  }
}

// What lies beyond the halo may be anything.
TEST(LandmarkStage, BeyondTheHaloNothingIsRead) {
  const Row row(12);
  std::set<std::size_t> read;
  Camera camera;
  camera.fx_px = camera.fy_px = kFocal_px;
  const LandmarkStageInput input{[&](std::size_t p) {
                                   read.insert(p);
                                   return row.Features(p, false);
                                 },
                                 [&](std::size_t p) { return row.Features(p, true); },
                                 row.content(),
                                 {},
                                 camera,
                                 {},
                                 20};
  std::vector<MapPanorama> panoramas = row.content().panoramas;
  std::vector<RefinementReport> report;
  (void)MakeLandmarkTile(input, 5, 7, &panoramas, &report);
  EXPECT_EQ(read, (std::set<std::size_t>{3, 4, 5, 6, 7, 8}));
}

TEST(LandmarkStage, PanoramasWithoutFeaturesHaveNoLandmarks) {
  const Row row(3);
  const LandmarkStageInput input{[](std::size_t) { return PanoramaFeatures{}; },
                                 [](std::size_t) { return PanoramaFeatures{}; },
                                 row.content(),
                                 {},
                                 Camera::FromHorizontalFov(640, 480, 70),
                                 {}};
  std::vector<MapPanorama> panoramas = row.content().panoramas;
  std::vector<RefinementReport> report;
  const BundleTile tile = MakeLandmarkTile(input, 0, 3, &panoramas, &report);
  EXPECT_TRUE(tile.landmarks.empty());
  EXPECT_TRUE(tile.anchors.empty());
  ASSERT_EQ(report.size(), 3U);
  for (std::size_t p = 0; p < 3; ++p) {
    EXPECT_THAT(panoramas[p].map_from_pano,
                Rigid3Near(row.content().panoramas[p].map_from_pano, 1e-7, 1e-8));
  }
}

}  // namespace
}  // namespace panofix
