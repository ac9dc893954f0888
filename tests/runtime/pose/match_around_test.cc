#include <gtest/gtest.h>

#include <algorithm>

#include "runtime/pose/guided_matching.h"
#include "tests/runtime/pose/synthetic_street.h"

namespace panofix {
namespace {

const Eigen::Vector3d kPlace(0.5, 18, 1.5);
constexpr double kHeading_deg = 15, kRadius_px = 130, kPixelSigma = 0.5;

ViewMatches Search(const FrameFeatures& frame, const Rigid3& cam_from_local) {
  const KeypointGrid grid(frame.sift, Street().camera());
  const auto landmarks = CollectLandmarks(*Street().bundle(), Street().stations(), Street().local(),
                                          Street().camera(), cam_from_local, {});
  return MatchAround(frame, grid, Street().camera(), landmarks, cam_from_local, kRadius_px, {});
}

// Matches whose keypoint is the landmark's own: within its noise of where the true pose puts it.
int CountRight(const ViewMatches& matches, const Rigid3& truth) {
  int num_right = 0;
  for (const Correspondence& c : matches.correspondences) {
    const Eigen::Vector3d x_in_cam = truth * c.point_in_map;
    const double off_px =
        (x_in_cam.hnormalized() - c.bearing_in_cam).norm() * Street().camera().fx_px;
    num_right += off_px < 5 * kPixelSigma ? 1 : 0;
  }
  return num_right;
}

TEST(MatchAround, FindsTheLandmarksOfAnErringPrediction) {
  const Rigid3 truth = Street().CamFromLocal(kPlace, kHeading_deg);
  const FrameFeatures frame = Street().Frame(truth, kPixelSigma, 200);
  const int num_at_truth = CountRight(Search(frame, truth), truth);
  EXPECT_GT(num_at_truth, 100);
  for (const auto& [offset, turn_deg] : {std::pair{Eigen::Vector3d(0.3, 1.0, 0), 0.0},
                                         {Eigen::Vector3d(-0.5, 0, 0.1), 3.0},
                                         {Eigen::Vector3d(0, -0.7, 0), -4.0}}) {
    const ViewMatches matches =
        Search(frame, Street().CamFromLocal(kPlace + offset, kHeading_deg + turn_deg));
    const int num_right = CountRight(matches, truth);
    // Some leave the window or the picture.
    EXPECT_GT(num_right, num_at_truth / 2) << offset.transpose() << " " << turn_deg;
    EXPECT_GT(num_right, static_cast<int>(matches.correspondences.size()) * 8 / 10);
  }
}

TEST(MatchAround, IsInTheOrderOfTheLandmarks) {
  const Rigid3 truth = Street().CamFromLocal(kPlace, kHeading_deg);
  const FrameFeatures frame = Street().Frame(truth, kPixelSigma, 200);
  const ViewMatches a = Search(frame, truth), b = Search(frame, truth);
  EXPECT_TRUE(std::is_sorted(a.landmark_ids.begin(), a.landmark_ids.end()));
  EXPECT_EQ(a.landmark_ids, b.landmark_ids);
  EXPECT_EQ(a.keypoint_idx, b.keypoint_idx);
}

TEST(MatchAround, AnotherPlaceFindsNextToNothing) {
  const Rigid3 truth = Street().CamFromLocal(kPlace, kHeading_deg);
  const FrameFeatures frame = Street().Frame(truth, kPixelSigma, 200);
  const std::size_t num_at_truth = Search(frame, truth).correspondences.size();
  EXPECT_LT(Search(frame, Street().CamFromLocal(kPlace, kHeading_deg + 180)).correspondences.size(),
            num_at_truth / 10);
}

TEST(MatchAround, NothingToFind) {
  EXPECT_TRUE(Search({}, Street().CamFromLocal(kPlace, kHeading_deg)).correspondences.empty());
  const Rigid3 far = Street().CamFromLocal({0, 500, 1.5}, 0);
  EXPECT_TRUE(Search(Street().Frame(far, kPixelSigma, 100), far).correspondences.empty());
}

// One landmark 10 m ahead in the middle of the picture, and keypoints beside it.
class OneLandmark : public testing::Test {
 protected:
  OneLandmark() {
    landmark_.match.point_in_map = {0, 0, 10};
    landmark_.size_m = static_cast<float>(kSize_px * 10 / camera_.fx_px);
    landmark_.angle_deg = 40;
    landmark_.up_in_local = -Eigen::Vector3f::UnitY();
    landmark_.descriptor.fill(40);
  }
  // Index of a keypoint off the landmark's, whose descriptor is `distance` away from the
  // landmark's.
  int Add(double x_px, int distance, float size_px = kSize_px, float angle_deg = 40) {
    const auto at = static_cast<float>(camera_.cx_px + x_px);
    frame_.sift.keypoints.push_back({at, static_cast<float>(camera_.cy_px), size_px, angle_deg, 1});
    auto descriptor = landmark_.descriptor;
    // Spread over entries, so that no byte runs over.
    for (std::size_t i = 0; i < 4; ++i)
      descriptor[i] = static_cast<std::uint8_t>(descriptor[i] + distance / 2);
    frame_.sift.descriptors.insert(frame_.sift.descriptors.end(), descriptor.begin(),
                                   descriptor.end());
    frame_.bearings.push_back(camera_.Normalize({double{at}, camera_.cy_px}));
    return static_cast<int>(frame_.sift.size()) - 1;
  }
  // Keypoint that is taken for the landmark, or -1.
  [[nodiscard]] int Found(const Rigid3& cam_from_local = {}) const {
    const KeypointGrid grid(frame_.sift, camera_);
    const ViewMatches matches =
        MatchAround(frame_, grid, camera_, {landmark_}, cam_from_local, kWindow_px, {});
    return matches.keypoint_idx.empty() ? -1 : matches.keypoint_idx.front();
  }
  static constexpr float kSize_px = 20;
  static constexpr double kWindow_px = 50;
  const Camera camera_ = Camera::FromHorizontalFov(640, 480, 70);
  FrameFeatures frame_;
  ReadyLandmark landmark_;
};

TEST_F(OneLandmark, TheNearestDescriptorIsTaken) {
  Add(3, 200);
  const int near = Add(40, 100);
  EXPECT_EQ(Found(), near);
}

TEST_F(OneLandmark, OutsideTheWindowIsNothing) {
  Add(51, 10);
  EXPECT_EQ(Found(), -1);
  const int inside = Add(49, 100);
  EXPECT_EQ(Found(), inside);
}

TEST_F(OneLandmark, ARepeatedDescriptorIsRefused) {
  const int first = Add(-10, 100);
  EXPECT_EQ(Found(), first);
  Add(20, 110);  // a ratio of 0.91
  EXPECT_EQ(Found(), -1);
}

TEST_F(OneLandmark, ADescriptorThatIsClearlyFartherIsNoRival) {
  const int first = Add(-10, 100);
  Add(20, 130);  // 0.77
  EXPECT_EQ(Found(), first);
}

TEST_F(OneLandmark, OneStructureAtTwoScalesIsNoRival) {
  const int first = Add(-10, 100);
  Add(-7, 102, kSize_px * 1.3F);
  EXPECT_EQ(Found(), first);
}

TEST_F(OneLandmark, ARivalOfAnotherShapeIsNone) {
  const int first = Add(-10, 100);
  Add(20, 100, kSize_px * 3);
  Add(25, 100, kSize_px, 120);
  EXPECT_EQ(Found(), first);
}

TEST_F(OneLandmark, StrangersAreRefusedHoweverAlone) {
  Add(0, 300);
  EXPECT_EQ(Found(), 0);
  frame_ = {};
  Add(0, 360);  // beyond the limit of 330
  EXPECT_EQ(Found(), -1);
}

TEST_F(OneLandmark, ARolledCameraTurnsOrientations) {
  const int level = Add(0, 100);
  for (const double roll_deg : {-60.0, 60.0}) {
    const Rigid3 rolled(
        Eigen::Quaterniond(Eigen::AngleAxisd(-roll_deg * M_PI / 180, Eigen::Vector3d::UnitZ())),
        Eigen::Vector3d::Zero());
    EXPECT_EQ(Found(rolled), -1);
    frame_.sift.keypoints[0].angle_deg = static_cast<float>(std::fmod(400 - roll_deg, 360.0));
    EXPECT_EQ(Found(rolled), level);
    frame_.sift.keypoints[0].angle_deg = 40;
  }
}

TEST_F(OneLandmark, BehindOrTooSmallIsNotLookedFor) {
  Add(0, 100);
  landmark_.match.point_in_map.z() = -10;
  EXPECT_EQ(Found(), -1);
  landmark_.match.point_in_map.z() = 10;
  landmark_.size_m /= 15;
  frame_.sift.keypoints[0].size_px /= 15;
  EXPECT_EQ(Found(), -1);
}

}  // namespace
}  // namespace panofix
