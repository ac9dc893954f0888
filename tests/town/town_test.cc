// The measuring instrument measured: ranges, poses and worlds against closed forms and brute force.
#include "tests/town/town.h"

#include <gtest/gtest.h>

#include <set>

#include "common/base/rng.h"

namespace panofix::town {
namespace {

using Eigen::Vector3d;

constexpr double kExact_m = 1e-9;   // double-precision plane intersection
constexpr double kSingle_m = 1e-3;  // which of two surfaces a single-precision ray meets first
constexpr double kRoundTrip_deg = 1e-9;

TownOptions Small() {
  TownOptions options;
  options.seed = 5;
  options.num_panoramas = 4;
  options.num_frames = 5;
  options.pano_width_px = 256;
  options.frame_width_px = 80;
  options.frame_height_px = 60;
  return options;
}

const Town& SmallTown() {
  static const Town town = Town::Generate(Small());
  return town;
}

Vector3d RandomRay(Rng& rng) {
  return Vector3d(rng.Normal(), rng.Normal(), rng.Normal()).normalized();
}

// Double-precision oracle: nearest of all quads whose two triangles hold the hit.
template <typename Quads>
std::optional<double> BruteForce(const Quads& quads, const Vector3d& origin, const Vector3d& ray) {
  std::optional<double> nearest;
  for (const auto& quad : quads) {
    const double speed = quad.normal.dot(ray);
    const double range = (quad.d - quad.normal.dot(origin)) / speed;
    if (!(range > 0) || (nearest && range >= *nearest)) continue;
    const Vector3d at = origin + range * ray;
    int side = 0;
    for (int i = 0; i < 4; ++i) {
      const Vector3d a = quad.corners[i].template cast<double>();
      const Vector3d b = quad.corners[(i + 1) % 4].template cast<double>();
      side += (b - a).cross(at - a).dot(quad.normal) >= 0 ? 1 : 0;
    }
    if (side == 4) nearest = range;
  }
  return nearest;
}

TEST(SceneTest, RangeToAWallIsTheClosedForm) {
  World world;
  world.AddQuad({5, 10, -10}, {5, -10, -10}, {5, -10, 10}, {5, 10, 10}, world.AddMaterial({}));
  EXPECT_NEAR(world.quads[0].normal.x(), -1, kExact_m);
  const Scene scene(world.quads);
  const Vector3d origin(1, 0.5, 0.25);
  const Vector3d ray = Vector3d(1, 0.3, -0.2).normalized();
  const auto hit = scene.Cast(origin, ray);
  ASSERT_TRUE(hit.has_value());
  EXPECT_NEAR(hit->range_m, 4 / ray.x(), kExact_m);
  EXPECT_FALSE(scene.Cast(origin, -ray).has_value());
}

TEST(SceneTest, PacketsAgreeWithSingleRays) {
  const Scene& scene = SmallTown().renderer(Day::kMap).scene();
  const Vector3d origin = SmallTown().layout().panoramas[1].town_from_pano.translation;
  Rng rng(3, "packets");
  for (int round = 0; round < 20; ++round) {
    RayPacket packet;
    Vector3d rays[RayPacket::kSize];
    for (int k = 0; k < RayPacket::kSize; ++k) {
      rays[k] = RandomRay(rng);
      packet.active[k] = -1;
      packet.ox[k] = static_cast<float>(origin.x()), packet.dx[k] = static_cast<float>(rays[k].x());
      packet.oy[k] = static_cast<float>(origin.y()), packet.dy[k] = static_cast<float>(rays[k].y());
      packet.oz[k] = static_cast<float>(origin.z()), packet.dz[k] = static_cast<float>(rays[k].z());
    }
    scene.Cast(packet);
    for (int k = 0; k < RayPacket::kSize; ++k) {
      const auto hit = scene.Cast(origin, rays[k]);
      ASSERT_EQ(hit.has_value(), packet.quad[k] != kNoQuad);
      if (hit) {
        EXPECT_NEAR(packet.range[k], hit->range_m, 1e-4 * (1 + hit->range_m));
      }
    }
  }
}

TEST(TownTest, RangesAreThoseOfBruteForce) {
  Rng rng(11, "rays");
  int agree = 0, rays = 0;
  for (const PanoramaPose& pose : SmallTown().layout().panoramas) {
    const Vector3d origin = pose.town_from_pano.translation;
    for (int i = 0; i < 25; ++i) {
      const Vector3d ray = RandomRay(rng);
      const auto range = SmallTown().Range(Day::kMap, origin, ray);
      const auto oracle = BruteForce(SmallTown().world(Day::kMap).quads, origin, ray);
      const auto plane = SmallTown().PlaneRange(origin, ray);
      const auto plane_oracle = BruteForce(SmallTown().world(Day::kMap).planes, origin, ray);
      ++rays;
      agree += range.has_value() == oracle.has_value() &&
               (!range || std::abs(*range - *oracle) < kSingle_m) &&
               plane.has_value() == plane_oracle.has_value() &&
               (!plane || std::abs(*plane - *plane_oracle) < kSingle_m);
    }
  }
  // A ray in a hundred may pass an edge within single precision and meet the surface behind.
  EXPECT_GE(agree, rays - 1);
}

TEST(TownTest, GroundLiesAtThePanoramasHeight) {
  for (const PanoramaPose& pose : SmallTown().layout().panoramas) {
    const Vector3d origin = pose.town_from_pano.translation;
    const auto plane = SmallTown().PlaneRange(origin, -Vector3d::UnitZ());
    const auto range = SmallTown().Range(Day::kMap, origin, -Vector3d::UnitZ());
    ASSERT_TRUE(plane && range);
    EXPECT_NEAR(*plane, SmallTown().options().panorama_height_m, kExact_m);
    // Paint and covers lie 4 mm above the road.
    EXPECT_LE(*range, *plane + kExact_m);
    EXPECT_GT(*range, *plane - 0.005);
  }
}

TEST(TownTest, GroundSlopesByDefault) {
  const StreetGrid& grid = SmallTown().layout().grid;
  const double x0 = grid.x_knots_m[2], x1 = grid.x_knots_m[3], y = grid.y_lines_m[1];
  const double slope = std::abs(grid.GroundHeight(x1, y) - grid.GroundHeight(x0, y)) / (x1 - x0);
  EXPECT_GE(slope, 0.7 * Small().slope - 1e-9);
  EXPECT_LE(slope, 1.2 * Small().slope + 1e-9);
}

TEST(TownTest, EqualOptionsGiveEqualWorlds) {
  const Town again = Town::Generate(Small());
  TownOptions other_options = Small();
  other_options.seed = 6;
  const Town other = Town::Generate(other_options);
  for (const Day day : {Day::kMap, Day::kDrive}) {
    const auto &a = SmallTown().world(day).quads, &b = again.world(day).quads;
    ASSERT_EQ(a.size(), b.size());
    for (std::size_t i = 0; i < a.size(); ++i) {
      ASSERT_EQ(a[i].corners[0], b[i].corners[0]);
      ASSERT_EQ(a[i].corners[2], b[i].corners[2]);
    }
    EXPECT_NE(a.size(), other.world(day).quads.size());
  }
}

std::multiset<std::uint32_t> Seeds(const World& world, MaterialKind kind) {
  std::multiset<std::uint32_t> seeds;
  for (const Material& material : world.materials) {
    if (material.kind == kind) seeds.insert(material.seed);
  }
  return seeds;
}

TEST(TownTest, EveryFacadeTreeAndCarIsItsOwn) {
  const World& world = SmallTown().world(Day::kMap);
  for (const MaterialKind kind :
       {MaterialKind::kWall, MaterialKind::kBark, MaterialKind::kCarBody}) {
    const auto seeds = Seeds(world, kind);
    EXPECT_GT(seeds.size(), 10u);
    EXPECT_EQ(seeds.size(), std::set<std::uint32_t>(seeds.begin(), seeds.end()).size());
  }
}

TEST(TownTest, LookAlikesRepeatFacadesAndCars) {
  TownOptions options = Small();
  options.look_alikes = true;
  options.rebuilt_share = 0;
  const Town town = Town::Generate(options);
  for (const MaterialKind kind : {MaterialKind::kWall, MaterialKind::kCarBody}) {
    const auto seeds = Seeds(town.world(Day::kMap), kind);
    EXPECT_GT(seeds.size(), 10u);
    EXPECT_EQ(std::set<std::uint32_t>(seeds.begin(), seeds.end()).size(), 1u);
  }
}

TEST(TownTest, TheDriveSeesOtherCarsAndSomeOtherFacades) {
  const World &map = SmallTown().world(Day::kMap), &drive = SmallTown().world(Day::kDrive);
  EXPECT_EQ(map.num_rebuilt, 0);
  EXPECT_GT(drive.num_rebuilt, 0);
  const auto before = Seeds(map, MaterialKind::kWall), after = Seeds(drive, MaterialKind::kWall);
  std::multiset<std::uint32_t> kept;
  std::set_intersection(before.begin(), before.end(), after.begin(), after.end(),
                        std::inserter(kept, kept.end()));
  EXPECT_EQ(static_cast<int>(kept.size()), map.num_buildings - drive.num_rebuilt);
  const auto cars = Seeds(map, MaterialKind::kCarBody),
             other = Seeds(drive, MaterialKind::kCarBody);
  std::multiset<std::uint32_t> same_cars;
  std::set_intersection(cars.begin(), cars.end(), other.begin(), other.end(),
                        std::inserter(same_cars, same_cars.end()));
  EXPECT_TRUE(same_cars.empty());
}

TEST(TownTest, SameLightWithoutRebuildingIsTheSameTown) {
  TownOptions options = Small();
  options.same_light = true;
  options.rebuilt_share = 0;
  const Town town = Town::Generate(options);
  EXPECT_EQ(town.world(Day::kMap).quads.size(), town.world(Day::kDrive).quads.size());
  EXPECT_EQ(Seeds(town.world(Day::kMap), MaterialKind::kCarBody),
            Seeds(town.world(Day::kDrive), MaterialKind::kCarBody));
}

TEST(LayoutTest, OffMapFramesLieAwayFromEveryPanorama) {
  TownOptions options = Small();
  options.num_off_map_frames = 4;
  const Layout layout = PlanLayout(options);
  ASSERT_EQ(layout.frames.size(), 9u);
  for (const FramePose& frame : layout.frames) {
    double nearest_m = 1e9;
    for (const PanoramaPose& pose : layout.panoramas) {
      const Vector3d apart = pose.town_from_pano.translation - frame.town_from_cam.translation;
      nearest_m = std::min(nearest_m, apart.norm());
    }
    if (frame.off_map) {
      EXPECT_GT(nearest_m, 12);
    } else {
      EXPECT_LT(nearest_m, options.spacing_m);
    }
  }
}

TEST(LayoutTest, AGridOfStreetsIsLinkedThroughout) {
  TownOptions options = Small();
  options.num_blocks = 2;
  options.num_frames = 30;
  const Layout layout = PlanLayout(options);
  ASSERT_GT(layout.panoramas.size(), 40u);
  ASSERT_EQ(layout.frames.size(), 30u);
  std::map<std::string, const PanoramaPose*> by_id;
  for (const PanoramaPose& pose : layout.panoramas) by_id[pose.id] = &pose;
  std::set<std::string> reached;
  std::vector<std::string> open{layout.panoramas[0].id};
  while (!open.empty()) {
    const std::string id = open.back();
    open.pop_back();
    if (!reached.insert(id).second) continue;
    for (const std::string& link : by_id.at(id)->links) {
      const auto& back = by_id.at(link)->links;
      EXPECT_NE(std::find(back.begin(), back.end(), id), back.end()) << id << " " << link;
      open.push_back(link);
    }
  }
  EXPECT_EQ(reached.size(), layout.panoramas.size());
}

TEST(GeodesyTest, RoundTripsCloseFarFromTheOrigin) {
  for (const Geodetic& origin : {Geodetic{48.8016, 2.1315, 130}, Geodetic{-33.9, 179.9999, 3}}) {
    const TownGeodesy geodesy(origin, 21);
    for (const Vector3d& x :
         {Vector3d(0, 0, 0), Vector3d(900, -400, 12), Vector3d(-3000, 5000, 40)}) {
      const Geodetic point = geodesy.ToGeodetic(x);
      EXPECT_LT((geodesy.ToTown(point) - x).norm(), 1e-7);
      const Geodetic again = geodesy.ToGeodetic(geodesy.ToTown(point));
      EXPECT_NEAR(again.lat_deg, point.lat_deg, kRoundTrip_deg);
      EXPECT_NEAR(AngleDifferenceDeg(again.lon_deg, point.lon_deg), 0, kRoundTrip_deg);
    }
  }
}

TEST(GeodesyTest, AttitudesRoundTripAndFeelTheEarthsCurvature) {
  const TownGeodesy geodesy({48.8016, 2.1315, 130}, 21);
  const Vector3d x(2000, -1500, 10);
  const Attitude attitude{123.4, -7.5, 3.25};
  const Attitude again =
      geodesy.ToAttitude(x, geodesy.TownFromBody(geodesy.ToGeodetic(x), attitude));
  EXPECT_NEAR(again.heading_deg, attitude.heading_deg, kRoundTrip_deg);
  EXPECT_NEAR(again.pitch_deg, attitude.pitch_deg, kRoundTrip_deg);
  EXPECT_NEAR(again.roll_deg, attitude.roll_deg, kRoundTrip_deg);
  // Oracle: the vertical turns by the distance over the earth's radius.
  const Eigen::Matrix3d enu_from_town = geodesy.EnuFromTown(geodesy.ToGeodetic(x));
  const double tilt_rad = std::acos(enu_from_town(2, 2));
  EXPECT_NEAR(tilt_rad, x.head<2>().norm() / 6371000, 0.01 * tilt_rad);
}

TEST(GeodesyTest, StreetsTurnByTheYaw) {
  const TownGeodesy geodesy({48.8016, 2.1315, 130}, 20);
  // Body looking along town x: heading east turned 20 degrees towards north.
  Eigen::Matrix3d body;
  body.col(0) = -Vector3d::UnitY(), body.col(1) = Vector3d::UnitX(),
  body.col(2) = Vector3d::UnitZ();
  EXPECT_NEAR(geodesy.ToAttitude(Vector3d::Zero(), body).heading_deg, 70, kRoundTrip_deg);
}

TEST(TownOptionsTest, ErrorsNameTheField) {
  TownOptions options = Small();
  options.pano_width_px = 255;
  try {
    static_cast<void>(Town::Generate(options));
    FAIL() << "an odd width was accepted";
  } catch (const std::invalid_argument& error) {
    EXPECT_NE(std::string(error.what()).find("pano-width-px"), std::string::npos);
  }
  options = Small();
  options.slope = std::nan("");
  EXPECT_THROW(options.Check(), std::invalid_argument);
}

}  // namespace
}  // namespace panofix::town
