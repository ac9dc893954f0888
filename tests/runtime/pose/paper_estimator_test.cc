#include "runtime/pose/paper_estimator.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <stdexcept>

#include "common/geometry/attitude.h"
#include "tests/runtime/pose/pictured_wall.h"
#include "tests/runtime/pose/synthetic_street.h"
#include "tests/support/matchers.h"

namespace panofix {
namespace {

const Eigen::Vector3d kPosition(1.5, 17, 1.6);
constexpr double kHeading_deg = 20;
// The map's points are float and their pixels exact: what is left is the solver's.
constexpr double kExact_m = 2e-3, kExact_rad = 2e-4;
// Half a pixel of noise on some hundred points 5 to 60 m away.
constexpr double kNoisy_m = 0.1, kNoisy_rad = 0.01;

PaperOptions Options(const SyntheticStreet& street) {
  PaperOptions options;
  options.ransac.focal_px = street.camera().fx_px;
  options.refine.use_point_sigma = false;
  return options;
}

std::vector<ViewMatches> Matches(const SyntheticStreet& street, const FrameFeatures& frame) {
  std::vector<ViewMatches> views = street.Match(frame, 1, 3);
  for (ViewMatches& view : views) view = WithoutSigmas(view, street.camera().fx_px);
  return views;
}

class PaperPose : public testing::Test {
 protected:
  PaperPose() : truth_(street_.CamFromLocal(kPosition, kHeading_deg)) {}
  [[nodiscard]] PoseOutcome Estimate(std::span<const ViewMatches> views) const {
    return EstimatePaperPose(views, street_.bundle()->manifest().errors, Options(street_));
  }
  const SyntheticStreet street_{StreetShape::kTwoWalls};
  const Rigid3 truth_;
};

TEST_F(PaperPose, ExactMatchesGiveTheExactPose) {
  const std::vector<ViewMatches> views = Matches(street_, street_.Frame(truth_, 0, 0));
  const PoseOutcome outcome = Estimate(views);
  ASSERT_TRUE(outcome.trusted) << outcome.reason;
  EXPECT_THAT(outcome.cam_from_local.Inverse(), Rigid3Near(truth_.Inverse(), kExact_rad, kExact_m));
  EXPECT_GT(outcome.num_inliers, 30);
  EXPECT_FALSE(outcome.views.empty());
  EXPECT_TRUE(outcome.covariance.allFinite());
  EXPECT_GT(outcome.covariance(0, 0), 0);
}

TEST_F(PaperPose, NoiseAndClutterAreBorne) {
  const std::vector<ViewMatches> views = Matches(street_, street_.Frame(truth_, 0.5, 200));
  const PoseOutcome outcome = Estimate(views);
  ASSERT_TRUE(outcome.trusted) << outcome.reason;
  EXPECT_THAT(outcome.cam_from_local.Inverse(), Rigid3Near(truth_.Inverse(), kNoisy_rad, kNoisy_m));
}

TEST_F(PaperPose, AViewThatLiesIsOutvoted) {
  std::vector<ViewMatches> views = Matches(street_, street_.Frame(truth_, 0.5, 0));
  // Another place's pose, carried by its own matches: Tukey leaves them out of the adjustment.
  ViewMatches liar = views.back();
  const FrameFeatures other = street_.Frame(street_.CamFromLocal({1, 30, 1.6}, 0), 0, 0);
  for (const ViewMatches& view : Matches(street_, other)) {
    if (view.keypoint_idx.size() > 20 && view.keypoint_idx.size() < 60) liar = view;
  }
  views.push_back(liar);
  const PoseOutcome outcome = Estimate(views);
  ASSERT_TRUE(outcome.trusted) << outcome.reason;
  EXPECT_THAT(outcome.cam_from_local.Inverse(), Rigid3Near(truth_.Inverse(), kNoisy_rad, kNoisy_m));
}

// "Larger than 12".
TEST_F(PaperPose, TwelveInliersAreNoFixAndThirteenAre) {
  const std::vector<ViewMatches> all = Matches(street_, street_.Frame(truth_, 0, 0));
  const auto largest = std::max_element(all.begin(), all.end(), [](const auto& a, const auto& b) {
    return a.keypoint_idx.size() < b.keypoint_idx.size();
  });
  ASSERT_GE(largest->keypoint_idx.size(), 13U);
  for (const std::size_t count : {12U, 13U}) {
    ViewMatches few = *largest;
    few.correspondences.resize(count);
    few.keypoint_idx.resize(count), few.landmark_ids.resize(count);
    const PoseOutcome outcome = Estimate(std::vector<ViewMatches>{few});
    EXPECT_EQ(outcome.trusted, count == 13U) << outcome.num_inliers;
    EXPECT_EQ(outcome.reason, count == 13U ? "" : "no_consensus");
  }
}

TEST_F(PaperPose, NothingAndNonsenseAreNoFix) {
  EXPECT_EQ(Estimate({}).reason, "no_consensus");
  EXPECT_FALSE(Estimate(std::vector<ViewMatches>(3)).found);
  std::vector<ViewMatches> views = Matches(street_, street_.Frame(truth_, 0, 0));
  for (ViewMatches& view : views) {
    for (Correspondence& match : view.correspondences)
      match.point_in_map.x() = std::numeric_limits<double>::quiet_NaN();
  }
  EXPECT_FALSE(Estimate(views).found);
}

TEST_F(PaperPose, SigmasLetThePanoramasMove) {
  const std::vector<ViewMatches> views = street_.Match(street_.Frame(truth_, 0.5, 50), 1, 3);
  PaperOptions options = Options(street_);
  options.use_sigmas = options.refine.use_point_sigma = true;
  const PoseOutcome outcome =
      EstimatePaperPose(views, street_.bundle()->manifest().errors, options);
  ASSERT_TRUE(outcome.trusted) << outcome.reason;
  EXPECT_THAT(outcome.cam_from_local.Inverse(), Rigid3Near(truth_.Inverse(), kNoisy_rad, kNoisy_m));
  // What is not known of the map is not known of the pose.
  const Matrix6d exact_map = Estimate(Matches(street_, street_.Frame(truth_, 0.5, 50))).covariance;
  const auto position_variance = [](const Matrix6d& m) { return m.diagonal().head(3).sum(); };
  EXPECT_GT(position_variance(outcome.covariance), position_variance(exact_map));
}

TEST(KeypointsInView, AreWhereTheViewFoundThem) {
  constexpr float kPixel = 1e-2F;  // points are stored as floats, sizes and angles as codes
  const PicturedWall wall;
  std::vector<std::uint32_t> ids;
  const auto list = wall.bundle()->LandmarksOf(0);
  for (std::size_t i = 0; i < list.size(); ++i) ids.push_back(list[i]);
  const std::vector<Keypoint> found = KeypointsInView(*wall.bundle(), 0, ids, wall.local());
  ASSERT_EQ(found.size(), wall.frame().sift.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    const Keypoint& expected = wall.frame().sift.keypoints[i];
    EXPECT_NEAR(found[i].x_px, expected.x_px, kPixel);
    EXPECT_NEAR(found[i].y_px, expected.y_px, kPixel);
    EXPECT_NEAR(found[i].size_px, expected.size_px, 0.025F * expected.size_px);  // 4 % steps
    EXPECT_LT(std::abs(AngleDifferenceDeg(double{found[i].angle_deg}, double{expected.angle_deg})),
              1.0);
  }
  // Behind the opposite view nothing is to be seen.
  for (const Keypoint& k : KeypointsInView(*wall.bundle(), 2, ids, wall.local()))
    EXPECT_FALSE(std::isfinite(k.x_px));
}

TEST(PaperMatcher, KvldKeepsWhatTheImagesAgreeOn) {
  const PicturedWall wall;
  PaperMatcher kvld(wall.bundle(), wall.camera(), {});
  PaperOptions plain_options;
  plain_options.use_kvld = false;
  PaperMatcher plain(wall.bundle(), wall.camera(), plain_options);
  // Every third keypoint is moved away with its descriptor: its match is wrong.
  FrameFeatures frame = wall.frame();
  Rng rng(1, "tests/moved");
  for (std::size_t i = 0; i < frame.sift.size(); i += 3) {
    frame.sift.keypoints[i].x_px = static_cast<float>(rng.Uniform(0, wall.camera().width_px - 1));
    frame.sift.keypoints[i].y_px = static_cast<float>(rng.Uniform(0, wall.camera().height_px - 1));
  }
  const std::vector<std::uint32_t> views{0, 1};
  const auto all = plain.Match(frame, wall.image(), views, wall.local());
  const auto kept = kvld.Match(frame, wall.image(), views, wall.local());
  const auto count = [](const ViewMatches& matches, bool moved) {
    return std::count_if(matches.keypoint_idx.begin(), matches.keypoint_idx.end(),
                         [&](int k) { return (k % 3 == 0) == moved; });
  };
  ASSERT_GT(count(all[0], true), 50);
  EXPECT_GT(count(kept[0], false), 0.8 * static_cast<double>(count(all[0], false)));
  EXPECT_LT(count(kept[0], true), 0.1 * static_cast<double>(count(all[0], true)));
  EXPECT_TRUE(kept[1].keypoint_idx.empty());
  for (const Correspondence& match : kept[0].correspondences) {
    EXPECT_EQ(match.point_sigma_m, 0);
    EXPECT_DOUBLE_EQ(match.keypoint_sigma * wall.camera().fx_px, 1);
  }
}

TEST(PaperMatcher, SaysThatTheMapKeepsNoImages) {
  const SyntheticStreet street(StreetShape::kTwoWalls, 50);
  try {
    const PaperMatcher matcher(street.bundle(), street.camera(), {});
    ADD_FAILURE() << "nothing was thrown";
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("--keep-view-images"));
  }
  PaperOptions options;
  options.use_kvld = false;
  EXPECT_NO_THROW(PaperMatcher(street.bundle(), street.camera(), options));
  options.min_inliers = 2;
  EXPECT_THROW(PaperMatcher(street.bundle(), street.camera(), options), std::invalid_argument);
}

}  // namespace
}  // namespace panofix
