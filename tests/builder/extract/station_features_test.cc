#include "builder/extract/station_features.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <set>
#include <stdexcept>

#include "tests/builder/augment/street_views.h"

namespace panofix {
namespace {

// The kiosk street's two panoramas; the first one owns the stations.
class StationFeatures : public testing::Test {
 protected:
  StationFeatures() {
    const Street& street = KioskStreet();
    for (std::size_t i = 0; i < 2; ++i) {
      // The street lives on: nothing is owned here.
      sources_.push_back({i == 0 ? "near" : "far",
                          std::shared_ptr<const RenderSource>(std::shared_ptr<const RenderSource>(),
                                                              &street.sources[i]),
                          street.world_from_pano[0].Inverse() * street.world_from_pano[i]});
    }
  }
  [[nodiscard]] PanoramaFeatures Extract(const std::vector<Station>& stations) const {
    return ExtractStations(stations, sources_, ViewCamera(), ViewDirections(), options_);
  }
  [[nodiscard]] static Rigid3 WorldFromStation(const Station& station) {
    const Rigid3& owner = KioskStreet().world_from_pano[0];
    return {owner.rotation, owner * station.position_in_pano};
  }
  std::vector<StationSource> sources_;
  StationExtractOptions options_;
};

const Station kBetween{0, {1.0, 5, 0.1}};  // about half-way to the other panorama

// Calls visit(view, feature) on all.
void ForFeatures(const PanoramaFeatures& features,
                 const std::function<void(int, std::size_t)>& visit) {
  for (std::size_t v = 0; v < features.views.size(); ++v) {
    for (std::size_t i = 0; i < features.views[v].sift.size(); ++i) visit(static_cast<int>(v), i);
  }
}

TEST_F(StationFeatures, PointsLieOnTheWorldUnderTheirKeypoints) {
  const PanoramaFeatures features = Extract({kBetween});
  EXPECT_TRUE(features.has_depth);
  EXPECT_EQ(features.sources, (std::vector<std::string>{"near", "far"}));
  ASSERT_EQ(features.views.size(), 6U);
  std::array<int, 2> num_of_source{};
  int num_features = 0, num_off = 0;
  const Rigid3 world_from_station = WorldFromStation(kBetween);
  ForFeatures(features, [&](int v, std::size_t i) {
    const ViewFeatureSet& view = features.views[static_cast<std::size_t>(v)];
    ASSERT_EQ(view.points.size(), view.sift.size());
    const SurfacePoint& point = view.points[i];
    ASSERT_LT(point.source_idx, 2);
    ++num_of_source[point.source_idx];
    ++num_features;
    EXPECT_GT(point.range_sigma_m, 0.0F);
    // Brute force: what the world shows under the keypoint, seen from the station.
    const Keypoint& k = view.sift.keypoints[i];
    const Eigen::Vector3d ray = RayInWorld(world_from_station, v, double{k.x_px}, double{k.y_px});
    const auto truth = KioskStreet().world.Cast(world_from_station.translation, ray);
    const Eigen::Vector3d in_world =
        KioskStreet().world_from_pano[point.source_idx] * point.point_in_pano.cast<double>();
    constexpr double kFloat_m = 1e-3;  // planes and points are floats, some 30 m away
    if (!truth || (in_world - truth->point_in_world).norm() > kFloat_m ||
        truth->patch + 1 != point.surface_idx) {
      ++num_off;
    }
  });
  EXPECT_GT(num_features, 100);
  EXPECT_GT(num_of_source[0], 10);
  EXPECT_GT(num_of_source[1], 10);
  // Outlines of the depth are stairs of 0.7 degrees.
  EXPECT_LE(num_off, num_features / 50);
}

// Brute force over the world: around a keypoint, as far as its descriptor looks, there is one patch
// and no sky. A surface's outline is only known to a depth pixel of 0.7 degrees.
TEST_F(StationFeatures, FeaturesLieWholeOnOneSurface) {
  const PanoramaFeatures features = Extract({kBetween});
  const Rigid3 world_from_station = WorldFromStation(kBetween);
  const double stair_px = ViewCamera().fx_px * 2 * M_PI / kDepthWidth;
  int num_features = 0, num_broken = 0;
  ForFeatures(features, [&](int v, std::size_t i) {
    const ViewFeatureSet& view = features.views[static_cast<std::size_t>(v)];
    const Keypoint& k = view.sift.keypoints[i];
    bool is_whole = true;
    for (int step = 0; step < 16; ++step) {
      const double angle = step * M_PI / 8;
      const double radius_px = std::max(0.0, 1.5 * double{k.size_px} - stair_px);
      const Eigen::Vector3d ray =
          RayInWorld(world_from_station, v, double{k.x_px} + radius_px * std::cos(angle),
                     double{k.y_px} + radius_px * std::sin(angle));
      const auto hit = KioskStreet().world.Cast(world_from_station.translation, ray);
      is_whole = is_whole && hit && hit->patch + 1 == view.points[i].surface_idx;
    }
    ++num_features;
    num_broken += is_whole ? 0 : 1;
  });
  EXPECT_GT(num_features, 100);
  // A disc is sampled, and the depth map's stairs are larger from the station: a few slip through.
  EXPECT_LE(num_broken, num_features / 20);
}

TEST_F(StationFeatures, ViewsFollowStationByStation) {
  const Station other{0, {0, 2, 0}};
  const PanoramaFeatures both = Extract({kBetween, other}), first = Extract({kBetween}),
                         second = Extract({other});
  ASSERT_EQ(both.views.size(), 12U);
  for (std::size_t v = 0; v < 6; ++v) {
    EXPECT_EQ(both.views[v].sift.descriptors, first.views[v].sift.descriptors);
    EXPECT_EQ(both.views[v + 6].sift.descriptors, second.views[v].sift.descriptors);
    EXPECT_EQ(both.views[v + 6].mser.descriptors, second.views[v].mser.descriptors);
  }
}

TEST_F(StationFeatures, TheNearestSourcesAreTaken) {
  const auto used = [&](const Station& station) {
    std::set<int> sources;
    const PanoramaFeatures features = Extract({station});
    ForFeatures(features, [&](int v, std::size_t i) {
      sources.insert(features.views[static_cast<std::size_t>(v)].points[i].source_idx);
    });
    return sources;
  };
  options_.max_sources = 1;
  EXPECT_EQ(used({0, {0, 2, 0}}), std::set<int>{0});
  EXPECT_EQ(used({0, {1, 9, 0}}), std::set<int>{1});
  options_.max_sources = 4;
  options_.max_distance_m = 4;
  EXPECT_EQ(used({0, {0, 2, 0}}), std::set<int>{0});
}

TEST_F(StationFeatures, WhereNothingIsKnownViewsAreEmpty) {
  const auto expect_empty = [&](const char* name) {
    const PanoramaFeatures features = Extract({kBetween});
    ASSERT_EQ(features.views.size(), 6U) << name;
    for (const ViewFeatureSet& view : features.views) {
      EXPECT_EQ(view.sift.size() + view.mser.size() + view.points.size(), 0U) << name;
    }
  };
  options_.max_distance_m = 1;
  expect_empty("sources far away");
  options_ = {};
  options_.min_coverage = 1.01;
  expect_empty("views that show too little");
  options_ = {};
  sources_.clear();
  expect_empty("no sources");
  EXPECT_FALSE(Extract({kBetween}).has_depth);
  EXPECT_TRUE(Extract({}).views.empty());
}

TEST(StationExtractOptions, CheckNamesTheField) {
  EXPECT_NO_THROW(StationExtractOptions().Check());
  const auto refused = [](const char* field,
                          const std::function<void(StationExtractOptions*)>& change) {
    StationExtractOptions options;
    change(&options);
    try {
      options.Check();
      ADD_FAILURE() << field;
    } catch (const std::invalid_argument& error) {
      EXPECT_NE(std::string(error.what()).find(field), std::string::npos) << error.what();
    }
  };
  refused("max_sift", [](StationExtractOptions* o) { o->max_sift = 0; });
  refused("max_sources", [](StationExtractOptions* o) { o->max_sources = 0; });
  refused("max_sources", [](StationExtractOptions* o) { o->max_sources = 256; });
  refused("max_range_m", [](StationExtractOptions* o) { o->extract.max_range_m = 0; });
  refused("max_stretch", [](StationExtractOptions* o) { o->render.max_stretch = 0; });
}

}  // namespace
}  // namespace panofix
