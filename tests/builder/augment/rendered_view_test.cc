#include <gtest/gtest.h>

#include <limits>
#include <set>
#include <utility>

#include "tests/builder/augment/street_views.h"

namespace panofix {
namespace {

constexpr int kRadius_px = 8;

// What a disc shows, pixel by pixel.
struct Disc {
  int num_pixels = 0, num_nothing = 0;
  std::set<std::pair<int, int>> surfaces;  // source, surface
  [[nodiscard]] bool HasTwoSources() const {
    return !surfaces.empty() && surfaces.begin()->first != surfaces.rbegin()->first;
  }
};

Disc Look(const RenderedView& view, int x, int y, int radius) {
  Disc disc;
  for (int dy = -radius; dy <= radius; ++dy) {
    for (int dx = -radius; dx <= radius; ++dx) {
      if (dx * dx + dy * dy > radius * radius) continue;
      ++disc.num_pixels;
      const auto point = view.At({x + dx, y + dy});
      if (!point) {
        ++disc.num_nothing;
      } else {
        disc.surfaces.insert({point->source_idx, point->surface_idx});
      }
    }
  }
  return disc;
}

// Calls visit(view, view_idx, x, y, disc) on a grid over all views of the station.
template <typename Visit>
void ForDiscs(const Street& street, const Rigid3& station, const Visit& visit) {
  for (int view_idx = 0; view_idx < 6; ++view_idx) {
    const RenderedView view = street.Render(station, view_idx);
    for (int y = 10; y < 230; y += 5) {
      for (int x = 10; x < 310; x += 5) visit(view, view_idx, x, y, Look(view, x, y, kRadius_px));
    }
  }
}

TEST(RenderedViewIsWhole, OneSurfaceIsWholeAndHolesAndSeamsAreNot) {
  int num_one = 0, num_broken = 0, num_missed = 0;
  ForDiscs(KioskStreet(), StationPose(),
           [&](const RenderedView& view, int, int x, int y, const Disc& disc) {
             const bool is_whole = view.IsWhole({x, y}, kRadius_px);
             const Disc wider = Look(view, x, y, kRadius_px + 1);  // samples fall in pixels
             if (wider.num_nothing == 0 && wider.surfaces.size() == 1) {
               ++num_one;
               EXPECT_TRUE(is_whole) << x << "," << y;
             } else if (disc.num_nothing > 0 || disc.HasTwoSources()) {
               ++num_broken;
               if (is_whole) ++num_missed;
               // Only slivers slip between the samples.
               if (is_whole) {
                 EXPECT_LT(disc.num_nothing, 0.1 * disc.num_pixels);
               }
             }
           });
  EXPECT_GT(num_one, 3000);
  EXPECT_GT(num_broken, 500);
  EXPECT_LT(num_missed, 0.06 * num_broken);
}

// By the truth: whether the disc's rim and centre lie on surfaces that meet there.
TEST(RenderedViewIsWhole, DepthStepsAreNotCreasesAre) {
  const Street& street = KioskStreet();
  const Rigid3 station = WorldFromPano(0.3, 0.3, 10);
  int num_steps = 0, num_creases = 0, num_whole_creases = 0;
  ForDiscs(street, station,
           [&](const RenderedView& view, int view_idx, int x, int y, const Disc& disc) {
             if (disc.num_nothing > 0 || disc.HasTwoSources() || disc.surfaces.size() != 2) return;
             const int a = disc.surfaces.begin()->second, b = disc.surfaces.rbegin()->second;
             // The kiosk's front (patch 4, surface 5) and left side (7) before walls (1..2, 4) are
             // a step, the ground (3) and the walls a crease.
             const bool has_kiosk =
                 a >= PlaneWorld::kFirstKioskPatch + 1 || b >= PlaneWorld::kFirstKioskPatch + 1;
             if (has_kiosk && (a == 1 || a == 2 || a == 4)) {
               ++num_steps;
               EXPECT_FALSE(view.IsWhole({x, y}, kRadius_px)) << view_idx << ": " << x << "," << y;
             } else if (!has_kiosk) {
               ++num_creases;
               num_whole_creases += view.IsWhole({x, y}, kRadius_px) ? 1 : 0;
             }
           });
  EXPECT_GT(num_steps, 20);
  EXPECT_GT(num_creases, 50);
  EXPECT_GT(num_whole_creases, 0.9 * num_creases);
}

TEST(RenderedViewIsWhole, BordersCountForWhatTheyShow) {
  const RenderedView view = EmptyStreet().Render(WorldFromPano(0, 0, 10), 1);
  // A point on the wall at the view's left border: half of its disc lies outside.
  int num_whole = 0;
  for (int y = 60; y < 120; y += 10) num_whole += view.IsWhole({2, y}, kRadius_px) ? 1 : 0;
  EXPECT_EQ(num_whole, 6);
  EXPECT_FALSE(view.IsWhole({-3, 100}, kRadius_px));
  EXPECT_FALSE(view.IsWhole({std::numeric_limits<double>::quiet_NaN(), 3}, kRadius_px));
}

TEST(RenderedViewAt, RoundsToThePixelAndKnowsTheBorder) {
  const RenderedView view = EmptyStreet().Render(StationPose(), 1);
  EXPECT_TRUE(view.At({-0.5, 100}));
  EXPECT_FALSE(view.At({-0.51, 100}));
  EXPECT_TRUE(view.At({319.49, 100}));
  EXPECT_FALSE(view.At({319.5, 100}));
  EXPECT_FALSE(view.At({100, 240}));
  EXPECT_FALSE(view.At({1e300, 100}));
  EXPECT_FALSE(view.At({std::numeric_limits<double>::quiet_NaN(), 100}));
  // Sub-pixel: the plane at the very ray.
  const auto left = view.At({100, 100}), right = view.At({100.4, 100}), same = view.At({100, 100});
  EXPECT_NE(left->point_in_source, right->point_in_source);
  EXPECT_EQ(left->point_in_source, same->point_in_source);
}

TEST(RenderedViewAt, OutlivesItsSources) {
  RenderedView view;
  {
    const Street street(PlaneWorld::Street());
    view = street.Render(StationPose(), 2);
  }
  EXPECT_TRUE(view.At({160, 100}));
  EXPECT_TRUE(view.IsWhole({160, 100}, 3));
}

}  // namespace
}  // namespace panofix
