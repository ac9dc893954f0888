#include <gtest/gtest.h>

#include "common/geometry/attitude.h"
#include "common/map/map_bundle.h"

namespace panofix {
namespace {

// Lambert-93 coordinates are millions of metres: doubles keep a nanometre of them.
constexpr double kRounding_m = 1e-8;

MapPanorama PanoramaAt(const MapFrame& frame, const Geodetic& point, double heading_deg) {
  MapPanorama panorama;
  panorama.position = point;
  panorama.map_from_pano =
      Rigid3(Eigen::Matrix3d(frame.MapFromEnu(point) * EnuFromBody({heading_deg, 0, 0})),
             frame.ToMap(point));
  panorama.point_scale = frame.PointScale(point);
  return panorama;
}

TEST(LocalFrame, RoundTripCloses) {
  const MapFrame frame = *MapFrame::FromName("EPSG:2154");
  const LocalFrame local = LocalFrame::At(PanoramaAt(frame, {46.5, 3.2, 120}, 30));
  EXPECT_NE(local.point_scale, 1.0);
  for (const Eigen::Vector3d& x :
       {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(100, -50, 7), Eigen::Vector3d(-3, 2000, -20)}) {
    EXPECT_LE((local.FromMap(local.ToMap(x)) - x).norm(), kRounding_m);
  }
  EXPECT_LE(local.FromMap(local.origin_in_map).norm(), 0.0);
}

// 100 m on the ground are 99.905 m on the grid at 46.5 degrees: the local frame has the ground's.
TEST(LocalFrame, LengthsAreGroundLengths) {
  const MapFrame frame = *MapFrame::FromName("EPSG:2154");
  const Geodetic here{46.5, 3.2, 120};
  const LocalFrame local = LocalFrame::At(PanoramaAt(frame, here, 30));
  // A tangent plane at the place measures the ground.
  const MapFrame tangent = MapFrame::Tangent(here);
  const Geodetic there = tangent.ToGeodetic({60, 80, 125});
  const Eigen::Vector3d d = local.FromMap(frame.ToMap(there));
  EXPECT_NEAR(d.head<2>().norm(), 100, 1e-5);
  EXPECT_NEAR(d.z(), 5, kRounding_m);
  EXPECT_NEAR((frame.ToMap(there) - frame.ToMap(here)).head<2>().norm(), 99.905, 2e-3);
}

TEST(LocalFrame, APanoramaKeepsItsAttitude) {
  const MapFrame frame = *MapFrame::FromName("EPSG:2154");
  const MapPanorama a = PanoramaAt(frame, {46.5, 3.2, 120}, 30),
                    b = PanoramaAt(frame, {46.501, 3.2, 121}, -70);
  const Rigid3 local_from_b = LocalFrame::At(a).LocalFromPano(b);
  EXPECT_LE(AngleBetween(local_from_b.rotation, b.map_from_pano.rotation), 1e-7);
  EXPECT_NEAR(local_from_b.translation.z(), 1, kRounding_m);
  EXPECT_LE(LocalFrame::At(a).LocalFromPano(a).translation.norm(), 0.0);
}

}  // namespace
}  // namespace panofix
