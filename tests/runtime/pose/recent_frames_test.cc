#include "runtime/pose/recent_frames.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "tests/runtime/pose/synthetic_street.h"

namespace panofix {
namespace {

constexpr double kPixelSigma = 0.3, kHeading_deg = 60;
constexpr std::int64_t kFrame_ns = 100'000'000;
// Half a pixel over two metres' baseline at 7 to 20 m: some per cent; a few matches are wrong.
constexpr double kTol_m = 0.5, kLeastGood = 0.95;

// Frames are to share more points than the other tests need.
const SyntheticStreet& Dense() {
  static const SyntheticStreet street(StreetShape::kTwoWalls, 4000);
  return street;
}

Rigid3 PoseAt(double y) { return Dense().CamFromLocal({0, y, 1.6}, kHeading_deg); }

// Keyframes with exact poses every `step_m` from y = 10 on.
RecentFrames Drive(int num_frames, double step_m) {
  RecentFrames recent;
  PoseOutcome known;
  known.covariance = 1e-4 * Matrix6d::Identity();
  known.unmapped_m = 3;
  for (int i = 0; i < num_frames; ++i) {
    const Rigid3 cam_from_local = PoseAt(10 + step_m * i);
    const Rigid3 local_from_cam = cam_from_local.Inverse();
    recent.Add(i * kFrame_ns,
               {local_from_cam.rotation, Dense().local().ToMap(local_from_cam.translation)}, known,
               Dense().Frame(cam_from_local, kPixelSigma, 100));
  }
  return recent;
}

RecentPoints PointsOf(const RecentFrames& recent) {
  return recent.Triangulate(Dense().camera(), Dense().local(), {});
}

TEST(RecentFrames, PointsLieOnTheWalls) {
  const RecentPoints recent = PointsOf(Drive(5, 0.6));
  ASSERT_GT(recent.points.size(), 40U);
  const Rigid3 keyframe = PoseAt(10 + 0.6 * 4);
  // The way goes between walls 7 m to each side.
  const Eigen::Vector3d along = (CentreOf(PoseAt(20)) - CentreOf(PoseAt(10))).normalized();
  const Eigen::Vector3d across = along.cross(Eigen::Vector3d::UnitZ());
  int num_good = 0;
  for (const ReadyLandmark& point : recent.points) {
    EXPECT_EQ(point.match.panorama_idx, RecentPoints::kPanorama);
    EXPECT_GT(point.match.range_sigma_in_map.norm(), 0);
    EXPECT_LT((point.match.lever_in_map + CentreOf(keyframe) - point.match.point_in_map).norm(),
              1e-6);
    const double wall_m = std::abs(point.match.lever_in_map.dot(across));
    num_good += std::abs(wall_m - 7) < kTol_m ? 1 : 0;
  }
  EXPECT_GT(num_good, kLeastGood * static_cast<double>(recent.points.size()));
  EXPECT_NEAR(recent.keyframe.position_sigma_m, 0.01, 1e-9);
  EXPECT_EQ(recent.keyframe.panorama_idx, RecentPoints::kPanorama);
  EXPECT_EQ(recent.unmapped_m, 3);
}

TEST(RecentFrames, WithoutAWayThereIsNoPoint) {
  EXPECT_TRUE(PointsOf(RecentFrames{}).points.empty());
  EXPECT_TRUE(PointsOf(Drive(1, 0.6)).points.empty());
  EXPECT_TRUE(PointsOf(Drive(20, 0.01)).points.empty());  // 0.2 m in all
}

TEST(RecentFrames, TimesThatRunBackwardsAndOldFramesAreForgotten) {
  for (const std::int64_t now_ns :
       {std::int64_t{0}, std::int64_t{40} * 1'000'000'000, std::numeric_limits<std::int64_t>::min(),
        std::numeric_limits<std::int64_t>::max()}) {
    RecentFrames recent = Drive(5, 0.6);
    recent.Advance(5 * kFrame_ns);
    EXPECT_FALSE(PointsOf(recent).points.empty());
    recent.Advance(now_ns);
    EXPECT_TRUE(PointsOf(recent).points.empty()) << now_ns;
  }
}

}  // namespace
}  // namespace panofix
