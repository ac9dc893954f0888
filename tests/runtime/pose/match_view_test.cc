#include <gtest/gtest.h>

#include "tests/runtime/pose/synthetic_street.h"

namespace panofix {
namespace {

// Points are stored as floats, some 30 m long.
constexpr double kFloat_m = 1e-4;
constexpr double kFloat = 1e-6;      // of numbers near one
constexpr double kHalfStep = 0.021;  // relative, of a length's code: half of its 4 %, and a little

std::uint32_t AnchorOf(std::uint32_t landmark_id) {
  return Street().bundle()->Landmark(landmark_id).panorama_idx;
}

bool Shows(std::uint32_t view_idx, std::uint32_t landmark_id) {
  const MapBundle::LandmarkList list = Street().bundle()->LandmarksOf(view_idx);
  for (std::size_t i = 0; i < list.size(); ++i) {
    if (list[i] == landmark_id) return true;
  }
  return false;
}

TEST(KeypointSigma, GrowsWithTheRegion) {
  EXPECT_GT(KeypointSigma_px(0), 0.0);
  EXPECT_EQ(KeypointSigma_px(0), KeypointSigma_px(2));
  EXPECT_GT(KeypointSigma_px(40), KeypointSigma_px(20));
}

TEST(MatchView, PointsAndBearingsAgreeWithThePose) {
  const Rigid3 cam_from_local = Street().CamFromLocal({0.5, 10, 1.5}, 20);
  const FrameFeatures frame = Street().Frame(cam_from_local, 0, 100);
  const auto views = Street().Match(frame, 0, 5);
  ASSERT_GT(views.size(), 5U);
  std::size_t num_matches = 0;
  for (const ViewMatches& view : views) {
    ASSERT_EQ(view.correspondences.size(), view.keypoint_idx.size());
    ASSERT_EQ(view.correspondences.size(), view.landmark_ids.size());
    num_matches += view.correspondences.size();
    for (std::size_t i = 0; i < view.correspondences.size(); ++i) {
      const Correspondence& c = view.correspondences[i];
      const auto k = static_cast<std::size_t>(view.keypoint_idx[i]);
      EXPECT_EQ(c.bearing_in_cam, frame.bearings[k]);
      const Eigen::Vector3d x_in_cam = cam_from_local * c.point_in_map;
      EXPECT_LE((x_in_cam.hnormalized() - c.bearing_in_cam).norm() * x_in_cam.z(), kFloat_m);
      EXPECT_EQ(c.view_idx, static_cast<int>(view.view_idx));
      EXPECT_EQ(c.panorama_idx, static_cast<int>(AnchorOf(view.landmark_ids[i])));
      EXPECT_TRUE(Shows(view.view_idx, view.landmark_ids[i]));
    }
  }
  EXPECT_GT(num_matches, 200U);
}

TEST(MatchView, ErrorsFollowTheAnchorsRay) {
  const Rigid3 cam_from_local = Street().CamFromLocal({0.5, 10, 1.5}, 20);
  const FrameFeatures frame = Street().Frame(cam_from_local, 0, 0);
  const double fx_px = Street().camera().fx_px;
  for (const ViewMatches& view : Street().Match(frame, 1, 2)) {
    for (std::size_t i = 0; i < view.correspondences.size(); ++i) {
      const Correspondence& c = view.correspondences[i];
      const MapPanorama& anchor = Street().bundle()->panoramas()[AnchorOf(view.landmark_ids[i])];
      const Eigen::Vector3d centre = Street().local().FromMap(anchor.map_from_pano.translation);
      EXPECT_LE((c.lever_in_map - (c.point_in_map - centre)).norm(), 1e-9);
      // Two percent of the range, and what a plane may be wrong by, along the ray.
      EXPECT_LE((c.range_sigma_in_map - std::hypot(0.02, kPlaneRangeShare) * c.lever_in_map).norm(),
                kHalfStep * 0.02 * c.lever_in_map.norm());
      const auto k = static_cast<std::size_t>(view.keypoint_idx[i]);
      EXPECT_NEAR(c.keypoint_sigma, KeypointSigma_px(frame.sift.keypoints[k].size_px) / fx_px,
                  1e-12);
      EXPECT_NEAR(c.point_sigma_m, kStreetPointSigma_m, kHalfStep * kStreetPointSigma_m);
      // The wall's plane, whose error all that lie on it share.
      EXPECT_EQ(c.surface_id / 256, c.panorama_idx);
      const double right = c.point_in_map.x() > 0 ? 1 : -1;
      EXPECT_LE((c.surface_normal_in_map - right * Eigen::Vector3d::UnitX()).norm(), kFloat);
      EXPECT_NEAR(c.surface_distance_sigma, kStreetShareSigma, kFloat);
      EXPECT_NEAR(c.surface_normal_sigma_rad, kStreetNormalSigma_rad, kFloat);
    }
  }
}

TEST(MatchView, AFrameWithoutFeaturesHasNoMatches) {
  EXPECT_TRUE(Street().Match({}, 0, 5).empty());
}

TEST(MatchView, StrangersDoNotMatch) {
  const FrameFeatures frame = Street().Frame(Street().CamFromLocal({0, 5000, 1.5}, 0), 0, 300);
  ASSERT_EQ(frame.sift.size(), 300U);
  std::size_t num_matches = 0;
  for (const ViewMatches& view : Street().Match(frame, 0, 5))
    num_matches += view.correspondences.size();
  EXPECT_LT(num_matches, 300U / 10);
}

}  // namespace
}  // namespace panofix
