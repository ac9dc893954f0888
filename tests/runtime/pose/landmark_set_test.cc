#include "runtime/pose/landmark_set.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "common/geometry/attitude.h"
#include "tests/runtime/pose/synthetic_street.h"

namespace panofix {
namespace {

constexpr double kFloat_m = 1e-4;    // points are stored as floats, some 30 m long
constexpr double kHalfStep = 0.021;  // relative, of a length's code: half of its 4 %, and a little

std::vector<ReadyLandmark> Collect(const Rigid3& cam_from_local,
                                   const LandmarkSetOptions& options = {}) {
  return CollectLandmarks(*Street().bundle(), Street().stations(), Street().local(),
                          Street().camera(), cam_from_local, options);
}

std::set<std::uint32_t> IdsOf(const std::vector<ReadyLandmark>& landmarks) {
  std::set<std::uint32_t> ids;
  for (const ReadyLandmark& landmark : landmarks) ids.insert(landmark.id);
  return ids;
}

// By the streets' layout: stations lie on x = 0, every 4 m from y = 0.
std::vector<std::uint32_t> NearestStations(double y, std::size_t count) {
  std::vector<std::pair<double, std::uint32_t>> by_distance;
  for (std::uint32_t s = 0; s < 2 * kStreetPanoramas; ++s)
    by_distance.emplace_back(std::abs(4.0 * s - y), s);
  std::sort(by_distance.begin(), by_distance.end());
  std::vector<std::uint32_t> stations;
  for (std::size_t i = 0; i < count; ++i) stations.push_back(by_distance[i].second);
  return stations;
}

TEST(CollectLandmarks, EachOnceFromTheNearestStationsViewsThatLookAlong) {
  // A view and a camera of 70 degrees share directions up to 70; some are taken beyond.
  constexpr double kMostApart_deg = 80;
  const MapBundle& bundle = *Street().bundle();
  for (const double y : {1.0, 13.5, 22.9}) {
    for (const double heading_deg : {0.0, 100.0, 215.0}) {
      const Rigid3 cam_from_local = Street().CamFromLocal({0.4, y, 1.5}, heading_deg);
      const std::vector<ReadyLandmark> landmarks = Collect(cam_from_local);
      EXPECT_EQ(IdsOf(landmarks).size(), landmarks.size());
      EXPECT_GT(landmarks.size(), 30U);
      const std::vector<std::uint32_t> near = NearestStations(y, LandmarkSetOptions().num_stations);
      for (const ReadyLandmark& landmark : landmarks) {
        const MapView& view = bundle.views()[static_cast<std::size_t>(landmark.match.view_idx)];
        EXPECT_EQ(std::count(near.begin(), near.end(), view.station_idx), 1);
        const double view_heading_deg = 25.0 * view.panorama_idx + view.yaw_deg;
        EXPECT_LT(std::abs(AngleDifferenceDeg(view_heading_deg, heading_deg)), kMostApart_deg);
        const auto list = bundle.LandmarksOf(static_cast<std::size_t>(landmark.match.view_idx));
        EXPECT_TRUE(std::binary_search(list.numbers.begin(), list.numbers.end(),
                                       landmark.id - list.first_id));
      }
    }
  }
}

// What the camera sees and a near station shows in any of its views is all there.
TEST(CollectLandmarks, LeavesOutNothingThatTheCameraSees) {
  const MapBundle& bundle = *Street().bundle();
  const Rigid3 cam_from_local = Street().CamFromLocal({0, 16, 2.5}, 40);
  const std::set<std::uint32_t> collected = IdsOf(Collect(cam_from_local));
  int num_seen = 0;
  for (const std::uint32_t station : NearestStations(16, 3)) {
    for (std::uint32_t v = 0; v < kStreetViews; ++v) {
      const auto list = bundle.LandmarksOf(station * kStreetViews + v);
      for (std::size_t i = 0; i < list.size(); ++i) {
        const MapLandmark landmark = bundle.Landmark(list[i]);
        const Eigen::Vector3d x_in_local =
            Street().local().LocalFromPano(bundle.panoramas()[landmark.panorama_idx]) *
            landmark.point_in_pano;
        const auto px = Street().camera().Project(cam_from_local * x_in_local);
        if (!px || px->x() < 0 || px->x() > Street().camera().width_px - 1) continue;
        EXPECT_EQ(collected.count(list[i]), 1U) << list[i];
        ++num_seen;
      }
    }
  }
  EXPECT_GT(num_seen, 200);
}

TEST(CollectLandmarks, AreReadyForTheSearch) {
  const MapBundle& bundle = *Street().bundle();
  const LocalFrame& local = Street().local();
  for (const ReadyLandmark& ready : Collect(Street().CamFromLocal({0, 16, 1.5}, 0))) {
    const MapLandmark landmark = bundle.Landmark(ready.id);
    const MapPanorama& anchor = bundle.panoramas()[landmark.panorama_idx];
    const Rigid3 local_from_anchor = local.LocalFromPano(anchor);
    EXPECT_EQ(ready.match.panorama_idx, static_cast<int>(landmark.panorama_idx));
    EXPECT_LE((ready.match.point_in_map - local_from_anchor * landmark.point_in_pano).norm(), 1e-9);
    // On the walls.
    EXPECT_NEAR(std::abs(ready.match.point_in_map.x()), 7, kFloat_m);
    EXPECT_NEAR(ready.match.range_sigma_in_map.norm() /
                    (std::hypot(0.02, kPlaneRangeShare) * ready.match.lever_in_map.norm()),
                1, kHalfStep);
    EXPECT_EQ(double{ready.size_m}, double{static_cast<float>(landmark.size_m)});
    EXPECT_EQ(double{ready.angle_deg}, double{static_cast<float>(landmark.angle_deg)});
    EXPECT_LE((ready.up_in_local - Eigen::Vector3f::UnitZ()).norm(), 1e-6F);
    std::array<std::uint8_t, kDescriptorSize> descriptor;
    bundle.Descriptor(ready.id, descriptor.data());
    EXPECT_EQ(ready.descriptor, descriptor);
  }
}

TEST(CollectLandmarks, MoreStationsShowMore) {
  const Rigid3 cam_from_local = Street().CamFromLocal({0, 16, 1.5}, 0);
  LandmarkSetOptions options;
  std::set<std::uint32_t> previous;
  for (const std::size_t count : {1, 2, 5, 12}) {
    options.num_stations = count;
    const std::set<std::uint32_t> ids = IdsOf(Collect(cam_from_local, options));
    EXPECT_TRUE(std::includes(ids.begin(), ids.end(), previous.begin(), previous.end())) << count;
    previous = ids;
  }
  options.num_stations = 0;
  EXPECT_TRUE(Collect(cam_from_local, options).empty());
}

TEST(CollectLandmarks, FarFromAllStationsThereAreNone) {
  const LandmarkSetOptions options;
  const double end_m = 44 + options.max_distance_m;  // the last station stands at 44 m
  EXPECT_FALSE(Collect(Street().CamFromLocal({0, end_m - 0.1, 1.5}, 180)).empty());
  EXPECT_TRUE(Collect(Street().CamFromLocal({0, end_m + 0.1, 1.5}, 180)).empty());
}

}  // namespace
}  // namespace panofix
