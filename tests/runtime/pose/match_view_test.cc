#include <gtest/gtest.h>

#include <set>

#include "tests/runtime/pose/synthetic_street.h"

namespace panofix {
namespace {

// Points are stored as floats, some 30 m long.
constexpr double kFloat_m = 1e-4;

const SyntheticStreet& Street() {
  static const SyntheticStreet street(StreetShape::kTwoWalls);
  return street;
}

TEST(MatchView, PointsAndBearingsAgreeWithThePose) {
  const Rigid3 cam_from_local = Street().CamFromLocal({0.5, 10, 1.5}, 20);
  const FrameFeatures frame = Street().Frame(cam_from_local, 0, 100);
  const auto views = Street().Match(frame, 0, 5);
  ASSERT_GT(views.size(), 5U);
  std::size_t num_matches = 0;
  for (const ViewMatches& view : views) {
    ASSERT_EQ(view.correspondences.size(), view.keypoint_idx.size());
    num_matches += view.correspondences.size();
    for (std::size_t i = 0; i < view.correspondences.size(); ++i) {
      const Correspondence& c = view.correspondences[i];
      const auto k = static_cast<std::size_t>(view.keypoint_idx[i]);
      EXPECT_EQ(c.bearing_in_cam, frame.bearings[k]);
      const Eigen::Vector3d x_in_cam = cam_from_local * c.point_in_map;
      EXPECT_LE((x_in_cam.hnormalized() - c.bearing_in_cam).norm() * x_in_cam.z(), kFloat_m);
      EXPECT_EQ(c.view_idx, static_cast<int>(view.view_idx));
      EXPECT_EQ(c.panorama_idx, static_cast<int>(view.view_idx / 8));
    }
  }
  EXPECT_GT(num_matches, 200U);
}

TEST(MatchView, ErrorsFollowThePanoramasRay) {
  const Rigid3 cam_from_local = Street().CamFromLocal({0.5, 10, 1.5}, 20);
  const FrameFeatures frame = Street().Frame(cam_from_local, 0, 0);
  const double fx_px = Street().camera().fx_px;
  for (const ViewMatches& view : Street().Match(frame, 1, 2)) {
    const MapPanorama& panorama = Street().bundle()->panoramas()[view.view_idx / 8];
    const Eigen::Vector3d centre = Street().local().FromMap(panorama.map_from_pano.translation);
    for (std::size_t i = 0; i < view.correspondences.size(); ++i) {
      const Correspondence& c = view.correspondences[i];
      EXPECT_LE((c.lever_in_map - (c.point_in_map - centre)).norm(), 1e-9);
      // Two percent of the range, along the ray.
      EXPECT_LE((c.range_sigma_in_map - 0.02 * c.lever_in_map).norm(), 1e-5);
      const auto k = static_cast<std::size_t>(view.keypoint_idx[i]);
      EXPECT_NEAR(c.keypoint_sigma, KeypointSigma_px(frame.sift.keypoints[k].size_px) / fx_px,
                  1e-12);
      EXPECT_GE(c.point_sigma_m, 0.7 / fx_px * c.lever_in_map.norm() * (1 - 1e-6));
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
