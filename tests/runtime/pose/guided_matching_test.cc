#include "runtime/pose/guided_matching.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/runtime/pose/synthetic_street.h"

namespace panofix {
namespace {

const Eigen::Vector3d kPlace(0.5, 18, 1.5);
constexpr double kHeading_deg = 15;

// A pose known to a decimetre and half a degree.
Matrix6d SomeCovariance() {
  Matrix6d covariance = Matrix6d::Identity() * 1e-2;
  covariance.bottomRightCorner<3, 3>() *= 1e-2;
  return covariance;
}

GuidedMatches Search(const FrameFeatures& frame, const Rigid3& cam_from_local,
                     const GuidedOptions& options = {}) {
  const KeypointGrid grid(frame.sift, Street().camera());
  const auto landmarks = CollectLandmarks(*Street().bundle(), Street().stations(), Street().local(),
                                          Street().camera(), cam_from_local, {});
  return MatchGuided(frame, grid, Street().camera(), landmarks, cam_from_local, SomeCovariance(),
                     options);
}

TEST(MatchGuided, FindsTheLandmarksThatThePoseShows) {
  const Rigid3 cam_from_local = Street().CamFromLocal(kPlace, kHeading_deg);
  const FrameFeatures frame = Street().Frame(cam_from_local, 0.5, 200);
  const GuidedMatches matches = Search(frame, cam_from_local);
  EXPECT_GT(matches.num_visible, 100);
  EXPECT_GE(matches.num_found, matches.num_visible * 9 / 10);
  EXPECT_LE(matches.num_decoys, matches.num_visible / 20);
  const ViewMatches& found = matches.matches;
  ASSERT_EQ(static_cast<int>(found.correspondences.size()), matches.num_found);
  ASSERT_EQ(found.keypoint_idx.size(), found.correspondences.size());
  ASSERT_EQ(found.landmark_ids.size(), found.correspondences.size());
  for (std::size_t i = 0; i < found.keypoint_idx.size(); ++i) {
    const Correspondence& c = found.correspondences[i];
    EXPECT_EQ(c.bearing_in_cam, frame.bearings[static_cast<std::size_t>(found.keypoint_idx[i])]);
    // The right keypoint: its noise off the projection, five sigmas of it.
    const Eigen::Vector3d x_in_cam = cam_from_local * c.point_in_map;
    EXPECT_LE((x_in_cam.hnormalized() - c.bearing_in_cam).norm() * Street().camera().fx_px,
              5 * 0.5);
  }
}

TEST(MatchGuided, ASmallErrorOfThePoseIsBridged) {
  const FrameFeatures frame = Street().Frame(Street().CamFromLocal(kPlace, kHeading_deg), 0.5, 200);
  const GuidedMatches matches = Search(
      frame,
      Street().CamFromLocal(kPlace + Eigen::Vector3d(0.05, -0.05, 0.02), kHeading_deg + 0.3));
  EXPECT_GE(matches.num_found, matches.num_visible * 8 / 10);
}

TEST(MatchGuided, AWrongPoseFindsNextToNothing) {
  const FrameFeatures frame = Street().Frame(Street().CamFromLocal(kPlace, kHeading_deg), 0.5, 200);
  for (const auto& [offset, turn_deg] : {std::pair{Eigen::Vector3d(0, 8, 0), 0.0},
                                         {Eigen::Vector3d(0, 0, 0), 20.0},
                                         {Eigen::Vector3d(2, 0, 0), 0.0},
                                         {Eigen::Vector3d(0, 0, 0), 180.0}}) {
    const GuidedMatches matches =
        Search(frame, Street().CamFromLocal(kPlace + offset, kHeading_deg + turn_deg));
    EXPECT_GT(matches.num_visible, 50);
    EXPECT_LE(matches.num_found, matches.num_visible / 10) << offset.transpose() << " " << turn_deg;
  }
}

TEST(MatchGuided, SizeAndOrientationMustFit) {
  const Rigid3 cam_from_local = Street().CamFromLocal(kPlace, kHeading_deg);
  const FrameFeatures good = Street().Frame(cam_from_local, 0.5, 0);
  FrameFeatures grown = good, turned = good;
  for (Keypoint& k : grown.sift.keypoints) k.size_px *= 2.5F;
  for (Keypoint& k : turned.sift.keypoints) k.angle_deg = std::fmod(k.angle_deg + 90, 360.0F);
  EXPECT_EQ(Search(grown, cam_from_local).num_found, 0);
  EXPECT_EQ(Search(turned, cam_from_local).num_found, 0);
}

// A camera that is rolled sees every orientation turned by its roll, and must find them all the
// same.
TEST(MatchGuided, ARolledCameraTurnsOrientations) {
  const Rigid3 upright = Street().CamFromLocal(kPlace, kHeading_deg);
  for (const double roll_deg : {-30.0, 30.0}) {
    const Eigen::AngleAxisd roll(-roll_deg * M_PI / 180, Eigen::Vector3d::UnitZ());
    const Rigid3 rolled = Rigid3(Eigen::Quaterniond(roll), Eigen::Vector3d::Zero()) * upright;
    FrameFeatures frame = Street().Frame(rolled, 0.5, 0);
    // In the picture (y down, angles from x towards y) everything turns with the picture.
    for (Keypoint& k : frame.sift.keypoints) {
      k.angle_deg = static_cast<float>(std::fmod(double{k.angle_deg} - roll_deg + 360, 360.0));
    }
    const GuidedMatches matches = Search(frame, rolled);
    EXPECT_GE(matches.num_found, matches.num_visible * 9 / 10) << roll_deg;
  }
}

TEST(MatchGuided, FarFromAllPanoramasNothingIsVisible) {
  const Rigid3 far = Street().CamFromLocal({0, 500, 1.5}, 0);
  const GuidedMatches matches = Search(Street().Frame(far, 0.5, 100), far);
  EXPECT_EQ(matches.num_visible, 0);
  EXPECT_TRUE(matches.matches.correspondences.empty());
}

TEST(MatchGuided, AFrameWithoutFeatures) {
  const GuidedMatches matches = Search({}, Street().CamFromLocal(kPlace, kHeading_deg));
  EXPECT_GT(matches.num_visible, 100);
  EXPECT_EQ(matches.num_found, 0);
  EXPECT_EQ(matches.num_decoys, 0);
}

}  // namespace
}  // namespace panofix
