#include "builder/augment/view_renderer.h"

#include <gtest/gtest.h>

#include "tests/builder/augment/street_views.h"

namespace panofix {
namespace {

// Two bilinear samplings of an 8-bit texture that changes by at most 4 levels a panorama pixel.
constexpr int kMaxGreyError = 5;

TEST(ViewRenderer, AtAPanoramaEqualsItsCut) {
  const Street& street = KioskStreet();
  const Rectifier rectifier(ViewCamera(), ViewDirections());
  const GrayImage panorama = street.world.Panorama(street.world_from_pano[0], 1600);
  const std::vector<const RenderSource*> sources = {&street.sources[0]};
  const std::vector<Rigid3> poses(1);
  const ViewRenderer renderer(ViewCamera(), ViewDirections(), {});
  for (int view = 0; view < 6; ++view) {
    const RenderedView rendered = renderer.Render(sources, poses, view);
    const GrayImage cut = rectifier.Cut(panorama, view);
    EXPECT_GT(rendered.coverage(), 0.4);
    int num_known = 0, num_off = 0;
    ForPixels(1, [&](int x, int y) {
      if (!rendered.At({x, y})) return;
      ++num_known;
      // Where the panorama itself has an edge, a tenth of a pixel shows.
      if (std::abs(GreyAt(rendered.image, x, y) - GreyAt(cut, x, y)) > 2) ++num_off;
    });
    EXPECT_LT(num_off, num_known / 500) << view;
  }
}

TEST(ViewRenderer, BetweenPanoramasEqualsCastingRaysFromThere) {
  const Street& street = KioskStreet();
  const Rigid3 station = StationPose();
  for (int view = 0; view < 6; ++view) {
    const RenderedView rendered = street.Render(station, view);
    int num_known = 0, num_grey_off = 0, num_point_off = 0;
    ForPixels(1, [&](int x, int y) {
      const auto point = rendered.At({x, y});
      if (!point) return;
      ++num_known;
      const auto truth = street.world.Cast(station.translation, RayInWorld(station, view, x, y));
      if (!truth) {  // the sky, by the wall's upper edge
        ++num_point_off, ++num_grey_off;
        return;
      }
      const Rigid3& world_from_source =
          street.world_from_pano[static_cast<std::size_t>(point->source_idx)];
      // Planes are floats.
      constexpr double kMaxPointError_m = 1e-4;
      if (!((world_from_source * point->point_in_source - truth->point_in_world).norm() <
            kMaxPointError_m)) {
        ++num_point_off;
      } else {
        EXPECT_EQ(point->surface_idx, truth->patch + 1);
        EXPECT_NEAR(point->metres_per_px, point->point_in_source.norm() * 2 * M_PI / 1600, 1e-9);
      }
      const double grey = PlaneWorld::Grey(truth->point_in_world);
      if (std::abs(GreyAt(rendered.image, x, y) - grey) > kMaxGreyError) ++num_grey_off;
    });
    EXPECT_GT(num_known, 320 * 240 * 0.45) << view;
    EXPECT_NEAR(rendered.coverage(), num_known / (320.0 * 240.0), 1e-9);
    // The depth map's outlines are stairs of 0.7 degrees: a strip beside each edge may be wrong.
    EXPECT_LT(num_point_off, num_known * 0.02) << view;
    EXPECT_LT(num_grey_off, num_known * 0.03) << view;
  }
}

// Brute force over the world: ground and wall behind the kiosk.
TEST(ViewRenderer, WhatNoPanoramaSawIsNothing) {
  Street street(PlaneWorld::StreetWithKiosk());
  street.sources.pop_back();  // the one behind the kiosk
  const Rigid3 station = WorldFromPano(3.5, 14, 10);
  const Eigen::Vector3d eye = street.world_from_pano[0].translation;
  const auto is_seen = [&](const Eigen::Vector3d& point) {
    const auto hit = street.world.Cast(eye, (point - eye).normalized());
    return hit && (hit->point_in_world - point).norm() < 0.01;
  };
  int num_hidden = 0, num_shown = 0;
  for (int view = 0; view < 6; ++view) {
    const RenderedView rendered = street.Render(station, view);
    ForPixels(8, [&](int x, int y) {
      // Well inside what is hidden: the stairs of the depth map's outlines do not count.
      for (const int dx : {-6, 0, 6}) {
        for (const int dy : {-6, 0, 6}) {
          const auto hit =
              street.world.Cast(station.translation, RayInWorld(station, view, x + dx, y + dy));
          if (!hit || is_seen(hit->point_in_world)) return;
          // The kiosk's back: nobody knows that it is there, so what lies behind shows.
          if (hit->patch >= PlaneWorld::kFirstKioskPatch) return;
        }
      }
      ++num_hidden;
      if (rendered.At({x, y})) ++num_shown;
    });
  }
  EXPECT_GT(num_hidden, 20);
  EXPECT_EQ(num_shown, 0);
}

TEST(ViewRenderer, ASurfaceOfOneSourceHidesThoseOfAnother) {
  // The first source knows nothing of the kiosk, the second does.
  Street street(PlaneWorld::Street());
  const PlaneWorld with_kiosk = PlaneWorld::StreetWithKiosk();
  street.sources.pop_back();
  street.sources.push_back(with_kiosk.Source(street.world_from_pano[1]));
  const Rigid3 station = WorldFromPano(1, 7, 0);
  int num_kiosk = 0;
  for (int view = 0; view < 6; ++view) {
    const RenderedView rendered = street.Render(station, view);
    ForPixels(4, [&](int x, int y) {
      // The side that the second source saw, well inside.
      const auto hit = with_kiosk.Cast(station.translation, RayInWorld(station, view, x, y));
      if (!hit || hit->patch != PlaneWorld::kFirstKioskPatch + 2) return;
      if (std::abs(hit->point_in_world.y() - 8.5) > 1.2 || hit->point_in_world.z() > 0.2) return;
      ++num_kiosk;
      const auto point = rendered.At({x, y});
      if (!point) return;
      EXPECT_EQ(point->source_idx, 1);
      EXPECT_EQ(point->surface_idx, hit->patch + 1);
    });
  }
  EXPECT_GT(num_kiosk, 100);
}

TEST(ViewRenderer, DepthErrorsOfTheGroundHideNothing) {
  Street street(PlaneWorld::Street());
  // The second panorama, 18 m behind, is too far off to show this ground, but takes it for tilted
  // by 0.8 degrees, so that it rises before the first panorama's.
  street.world_from_pano[1] = WorldFromPano(0, -18, 0);
  street.sources.pop_back();
  const Rigid3 station = WorldFromPano(0, -1, 10);
  const double alone = street.Render(station, 0).coverage();
  street.sources.push_back(street.world.Source(street.world_from_pano[1]));
  street.world_from_pano[1].rotation =
      Eigen::AngleAxisd(0.8 * kRadPerDeg, Eigen::Vector3d::UnitX()) *
      street.world_from_pano[1].rotation;
  EXPECT_GT(street.Render(station, 0).coverage(), 0.98 * alone);
}

TEST(ViewRenderer, MaskedPixelsAreNotShown) {
  const Rigid3 pose = WorldFromPano(0, 0, 0);
  for (const int width_px : {64, 700, 1600}) {  // coarser and finer than the depth
    GrayImage mask{width_px, width_px / 2, {}};
    const int first_masked = 3 * mask.height_px / 5;
    mask.pixels.assign(static_cast<std::size_t>(width_px * first_masked), 0);
    mask.pixels.resize(static_cast<std::size_t>(width_px * mask.height_px), 7);
    const RenderSource source = PlaneWorld::Street().Source(pose, mask);
    const std::vector<const RenderSource*> sources = {&source};
    const std::vector<Rigid3> poses = {
        Rigid3(Eigen::Matrix3d(Eigen::Matrix3d::Identity()), Eigen::Vector3d(0.5, -1, 0))};
    const RenderedView rendered =
        ViewRenderer(ViewCamera(), ViewDirections(), {}).Render(sources, poses, 1);
    EXPECT_GT(rendered.coverage(), 0.3);
    double lowest_deg = 0;
    ForPixels(1, [&](int x, int y) {
      const auto point = rendered.At({x, y});
      if (!point) return;
      const Eigen::Vector3d& p = point->point_in_source;
      lowest_deg = std::min(lowest_deg, std::atan2(p.z(), p.head<2>().norm()) / kRadPerDeg);
    });
    // Smallest blocks show their first corner's surface, a pixel of 0.25 degrees off at most in
    // each direction, two for what lies nearer to the station.
    const double first_masked_deg = 180 * (0.5 - double{1} * first_masked / mask.height_px);
    EXPECT_GT(lowest_deg, first_masked_deg - 0.6) << width_px;
    EXPECT_LT(lowest_deg, first_masked_deg + 3) << width_px;
  }
}

// The options' limits against numeric derivatives of the points shown.
TEST(ViewRenderer, NothingSlantedFarOrSmearedIsShown) {
  const Street& street = EmptyStreet();
  RenderOptions options;
  options.max_incidence_deg = 65;
  options.max_range_m = 14;
  options.max_stretch = 1.5;
  options.good_stretch = 1.2;
  const Rigid3 station = StationPose();
  constexpr double kSlack = 1.03;  // a pixel's change of the limits, and the derivatives' own error
  double largest_stretch = 0, least_cosine = 1, largest_range_m = 0;
  for (int view = 0; view < 6; ++view) {
    const RenderedView rendered = street.Render(station, view, options);
    ForPixels(4, [&](int x, int y) {
      const auto point = rendered.At({x, y});
      if (!point) return;
      const Rigid3& source = street.world_from_pano[static_cast<std::size_t>(point->source_idx)];
      const Patch& patch = street.world.patches()[static_cast<std::size_t>(point->surface_idx - 1)];
      const auto sight_to = [&](const Eigen::Vector3d& from, const Eigen::Vector3d& ray) {
        const auto hit = street.world.Cast(station.translation, ray);
        return (hit->point_in_world - from).normalized();
      };
      const Eigen::Vector3d p = source * point->point_in_source;
      for (const Eigen::Vector3d& eye : {source.translation, station.translation}) {
        largest_range_m = std::max(largest_range_m, (p - eye).norm());
        least_cosine = std::min(least_cosine, std::abs(patch.Normal().dot((p - eye).normalized())));
      }
      // Smallest turn of the source's sight for a turn of the station's, over directions.
      const Eigen::Vector3d ray = RayInWorld(station, view, x, y);
      const Eigen::Vector3d e1 = ray.unitOrthogonal(), e2 = ray.cross(e1);
      constexpr double kTurn_rad = 1e-4;
      for (int i = 0; i < 18; ++i) {
        const double angle = i * M_PI / 18;
        const Eigen::Vector3d turn = kTurn_rad * (std::cos(angle) * e1 + std::sin(angle) * e2);
        const auto hit_a = street.world.Cast(station.translation, (ray - turn).normalized());
        const auto hit_b = street.world.Cast(station.translation, (ray + turn).normalized());
        if (!hit_a || hit_a->patch + 1 != point->surface_idx) return;  // an edge's stairs
        if (!hit_b || hit_b->patch + 1 != point->surface_idx) return;
        const double moved = (sight_to(source.translation, (ray + turn).normalized()) -
                              sight_to(source.translation, (ray - turn).normalized()))
                                 .norm();
        largest_stretch = std::max(largest_stretch, 2 * kTurn_rad / moved);
      }
    });
  }
  EXPECT_LE(largest_stretch, options.max_stretch * kSlack);
  EXPECT_GE(least_cosine * kSlack, std::cos(options.max_incidence_deg * kRadPerDeg));
  EXPECT_LE(largest_range_m, options.max_range_m * kSlack);
  // The limits are reached: this street does have what they cut off.
  EXPECT_GE(largest_stretch, options.max_stretch / 1.1);
  EXPECT_GE(largest_range_m, options.max_range_m / 1.1);
}

TEST(ViewRenderer, TheFirstGoodSourceIsTaken) {
  const Street& street = EmptyStreet();
  // Beside the first panorama: hardly anything is stretched, so it serves all that it saw.
  const Rigid3 station = WorldFromPano(0.3, 0.3, 10);
  for (int view = 0; view < 6; ++view) {
    const RenderedView rendered = street.Render(station, view);
    int num_first = 0, num_known = 0;
    ForPixels(2, [&](int x, int y) {
      const auto point = rendered.At({x, y});
      if (!point) return;
      ++num_known;
      if (point->source_idx == 0) ++num_first;
    });
    EXPECT_GT(num_first, 0.97 * num_known) << view;
  }
}

// A panorama of pixel noise on a wall that the source saw from near and the station sees from afar.
TEST(ViewRenderer, NothingAliases) {
  PlaneWorld world;
  world.Add({{0, 1, 0}, {8, 0, 0}, {0, 0, 8}});
  const Rigid3 pose;
  GrayImage checks{1600, 800, {}};
  for (int y = 0; y < 800; ++y) {
    for (int x = 0; x < 1600; ++x) checks.pixels.push_back((x + y) % 2 == 0 ? 0 : 255);
  }
  // A second plane, or the depth were a placeholder.
  world.Add({{0, -50, 0}, {1, 0, 0}, {0, 0, 1}});
  const RenderSource source(checks, {}, world.Depth(pose));
  const std::vector<const RenderSource*> sources = {&source};
  const std::vector<Rigid3> poses = {
      Rigid3(Eigen::Matrix3d(Eigen::Matrix3d::Identity()), Eigen::Vector3d(0, 6, 0))};
  const RenderedView rendered =
      ViewRenderer(ViewCamera(), ViewDirections(), {}).Render(sources, poses, 0);
  EXPECT_GT(rendered.coverage(), 0.1);
  constexpr int kMaxContrast = 20;  // of 127 each way
  int num_known = 0;
  ForPixels(1, [&](int x, int y) {
    const auto point = rendered.At({x, y});
    if (!point || point->point_in_source.norm() > 1.5) return;
    ++num_known;
    EXPECT_NEAR(GreyAt(rendered.image, x, y), 127, kMaxContrast);
  });
  EXPECT_GT(num_known, 100);
}

// Steep waves over a coarse panorama tell coordinates: 12 levels a pixel across, as many down.
TEST(ViewRenderer, InterpolatedCoordinatesAreRightToATenthOfAPixel) {
  const Rigid3 pose = WorldFromPano(0, 0, 0);
  constexpr double kWave_px = 52.36;  // amplitude 100: steepest 100 * 2 pi / 52.36 = 12 a pixel
  GrayImage waves{1000, 500, {}};
  const auto wave = [&](double x, double y) {
    return 128 + 60 * std::sin(2 * M_PI * x / 50) + 60 * std::sin(2 * M_PI * y / kWave_px);
  };
  for (int y = 0; y < 500; ++y) {
    for (int x = 0; x < 1000; ++x) {
      waves.pixels.push_back(static_cast<std::uint8_t>(std::lround(wave(x + 0.5, y + 0.5))));
    }
  }
  const RenderSource source(waves, {}, PlaneWorld::Street().Depth(pose));
  const std::vector<const RenderSource*> sources = {&source};
  const std::vector<Rigid3> poses = {
      Rigid3(Eigen::Matrix3d(Eigen::Matrix3d::Identity()), Eigen::Vector3d(-1, 0.5, 0))};
  // Also down to the ground below the panorama, round which the columns turn.
  std::vector<ViewDirection> directions = ViewDirections();
  directions.push_back({30, -60});
  const ViewRenderer renderer(ViewCamera(), directions, {});
  // A tenth of a pixel across and down at 7.5 levels a pixel each; bilinear sampling of the waves
  // and 8 bits twice.
  constexpr double kMaxError = 0.1 * 2 * 7.6 + 0.3 + 1;
  int num_known = 0;
  for (int view = 0; view < 7; ++view) {
    const RenderedView rendered = renderer.Render(sources, poses, view);
    ForPixels(1, [&](int x, int y) {
      const auto point = rendered.At({x, y});
      // Where the source is finer than the view, samples are averaged.
      if (!point || point->point_in_source.norm() <
                        0.8 * (point->point_in_source + poses[0].translation).norm()) {
        return;
      }
      ++num_known;
      const Eigen::Vector3d& p = point->point_in_source;
      const double across = (std::atan2(p.x(), p.y()) / (2 * M_PI) + 0.5) * 1000;
      const double down = (0.5 - std::atan2(p.z(), p.head<2>().norm()) / M_PI) * 500;
      EXPECT_NEAR(GreyAt(rendered.image, x, y), wave(across, down), kMaxError);
    });
  }
  EXPECT_GT(num_known, 100'000);
}

}  // namespace
}  // namespace panofix
