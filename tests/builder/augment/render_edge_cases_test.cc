// The renderer given little, odd or nonsensical input, and by several threads.

#include <gtest/gtest.h>

#include <limits>
#include <stdexcept>
#include <thread>

#include "builder/augment/view_renderer.h"
#include "tests/builder/augment/street_views.h"

namespace panofix {
namespace {

TEST(ViewRenderer, SourcesWithoutPlanesGiveNothing) {
  const ViewRenderer renderer(ViewCamera(), ViewDirections(), {});
  const RenderedView empty = renderer.Render({}, {}, 0);
  EXPECT_EQ(empty.coverage(), 0);
  EXPECT_FALSE(empty.At({100, 100}));
  EXPECT_FALSE(empty.IsWhole({100, 100}, 2));
  EXPECT_EQ(empty.image.pixels, std::vector<std::uint8_t>(320 * 240, 128));

  const auto everywhere = [](const Eigen::Vector3d&) { return 1; };
  const DepthMap placeholder = DepthMap::DecodeGsv(GsvText({{0, 0, -1, 2.5F}}, everywhere)).value();
  // Normal zero, distance zero, and a plane that its pixels look away from or along.
  const DepthMap degenerate =
      DepthMap::DecodeGsv(GsvText({{0, 0, 0, 2}, {0, 1, 0, 0}, {0, 1, 0, 3}},
                                  [](const Eigen::Vector3d& ray) { return ray.x() > 0 ? 1 : 2; }))
          .value();
  const GrayImage white{64, 32, std::vector<std::uint8_t>(64 * 32, 255)};
  for (const DepthMap& depth : {placeholder, degenerate}) {
    const RenderSource source(white, {}, depth);
    const std::vector<const RenderSource*> sources = {&source};
    EXPECT_EQ(renderer.Render(sources, std::vector<Rigid3>(1), 2).coverage(), 0);
  }
  const RenderSource hidden =
      PlaneWorld::Street().Source({}, GrayImage{1, 1, std::vector<std::uint8_t>(1, 255)});
  const std::vector<const RenderSource*> sources = {&hidden};
  EXPECT_EQ(renderer.Render(sources, std::vector<Rigid3>(1), 2).coverage(), 0);
}

TEST(ViewRenderer, AnyStationIsSurvived) {
  const Street& street = KioskStreet();
  const Eigen::Vector3d stations[] = {{6, 3, 0},     {0, 25, 0},   {4, 8.5, -1},
                                      {40, -70, 30}, {0, 0, -2.5}, {3, 7, 0.5}};
  for (const Eigen::Vector3d& station : stations) {
    for (int view = 0; view < 6; ++view) {
      const RenderedView rendered = street.Render({Eigen::Quaterniond::Identity(), station}, view);
      EXPECT_GE(rendered.coverage(), 0);
      ForPixels(3, [&](int x, int y) {
        if (const auto point = rendered.At({x, y})) {
          EXPECT_TRUE(point->point_in_source.allFinite());
        }
      });
    }
  }
}

TEST(ViewRenderer, OddSizesAndSteepViews) {
  const Street& street = KioskStreet();
  const Camera camera = Camera::FromHorizontalFov(61, 47, 100);
  const ViewRenderer renderer(camera, {{0, -90}, {15, 60}, {-400, -35}}, {});
  const std::vector<const RenderSource*> sources = {&street.sources[0]};
  const std::vector<Rigid3> poses(1);
  for (int view = 0; view < 3; ++view) {
    const RenderedView rendered = renderer.Render(sources, poses, view);
    EXPECT_EQ(rendered.image.pixels.size(), 61U * 47U);
  }
  // Straight down: nothing but the ground.
  EXPECT_GT(renderer.Render(sources, poses, 0).coverage(), 0.95);
}

TEST(ViewRenderer, SameBytesFromAnyThread) {
  const Street& street = KioskStreet();
  const RenderedView first = street.Render(StationPose(), 1);
  std::vector<RenderedView> others(4);
  {
    std::vector<std::jthread> threads;
    for (RenderedView& other : others) {
      threads.emplace_back([&] { other = street.Render(StationPose(), 1); });
    }
  }
  for (const RenderedView& other : others) {
    EXPECT_EQ(other.image.pixels, first.image.pixels);
    EXPECT_EQ(other.coverage(), first.coverage());
  }
}

TEST(ViewRenderer, RefusesWhatMakesNoSense) {
  const Street& street = EmptyStreet();
  const ViewRenderer renderer(ViewCamera(), ViewDirections(), {});
  const std::vector<const RenderSource*> sources = {&street.sources[0]};
  const std::vector<Rigid3> poses(1);
  EXPECT_THROW(static_cast<void>(renderer.Render(sources, {}, 0)), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(renderer.Render(sources, poses, 6)), std::out_of_range);
  EXPECT_THROW(static_cast<void>(renderer.Render(sources, poses, -1)), std::out_of_range);
  Camera distorted = ViewCamera();
  distorted.distortion[0] = 0.1;
  EXPECT_THROW(ViewRenderer(distorted, ViewDirections(), {}), std::invalid_argument);
  EXPECT_THROW(ViewRenderer({}, ViewDirections(), {}), std::invalid_argument);
  EXPECT_THROW(RenderSource({}, {}, PlaneWorld::Street().Depth({})), std::invalid_argument);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const RenderOptions bad[] = {{0.9, 0.5, 78, 60}, {nan, 1, 78, 60},   {2, 2.1, 78, 60},
                               {2, nan, 78, 60},   {2, 1.5, 90, 60},   {2, 1.5, 0, 60},
                               {2, 1.5, 78, 0},    {2, 1.5, 78, 1000}, {2, 1.5, 78, nan}};
  for (const RenderOptions& options : bad) {
    EXPECT_THROW(ViewRenderer(ViewCamera(), ViewDirections(), options), std::invalid_argument);
  }
}

}  // namespace
}  // namespace panofix
