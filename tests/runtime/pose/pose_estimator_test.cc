#include "runtime/pose/pose_estimator.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <functional>
#include <optional>
#include <stdexcept>

#include "tests/runtime/pose/synthetic_street.h"
#include "tests/support/matchers.h"

namespace panofix {
namespace {

// Half a pixel of noise over some 200 landmarks; landmarks are exact.
constexpr double kPixelSigma = 0.5, kTol_m = 0.05, kTol_rad = 0.005;

PoseOptions Options(const SyntheticStreet& street) {
  PoseOptions options;
  options.ransac.focal_px = street.camera().fx_px;
  return options;
}

PoseOutcome Estimate(const SyntheticStreet& street, const FrameFeatures& frame,
                     const std::vector<ViewMatches>& views, const PoseOptions& options) {
  return EstimatePose(street.Context(frame, options), views);
}

PoseOutcome Estimate(const SyntheticStreet& street, const FrameFeatures& frame,
                     const std::vector<ViewMatches>& views) {
  return Estimate(street, frame, views, Options(street));
}

TEST(EstimatePose, FindsThePoseAllAlongTheStreet) {
  for (const double y : {3.0, 14.5, 26.0, 38.0}) {
    for (const double heading_deg : {0.0, 40.0, 180.0}) {
      const Rigid3 truth = Street().CamFromLocal({0.8, y, 1.6}, heading_deg);
      const FrameFeatures frame = Street().Frame(truth, kPixelSigma, 100);
      const PoseOutcome outcome = Estimate(Street(), frame, Street().Match(frame, 0, 5));
      ASSERT_TRUE(outcome.found) << outcome.reason;
      EXPECT_TRUE(outcome.trusted) << outcome.reason;
      EXPECT_EQ(outcome.reason, "");
      EXPECT_THAT(outcome.cam_from_local.Inverse(), Rigid3Near(truth.Inverse(), kTol_rad, kTol_m))
          << y << " " << heading_deg;
      EXPECT_GT(outcome.num_inliers, 50);
      EXPECT_GT(outcome.spread, 0.1);
      ASSERT_FALSE(outcome.views.empty());
      EXPECT_EQ(outcome.best_view, outcome.views.front());
      const double sigma_m = std::sqrt(outcome.covariance.topLeftCorner<3, 3>().trace());
      EXPECT_GT(sigma_m, 1e-4);
      EXPECT_LT(sigma_m, 0.5);
    }
  }
}

void ExpectSame(const PoseOutcome& a, const PoseOutcome& b) {
  EXPECT_EQ(a.cam_from_local.translation, b.cam_from_local.translation);
  EXPECT_EQ(a.covariance, b.covariance);
  EXPECT_EQ(a.num_inliers, b.num_inliers);
  EXPECT_EQ(a.reason, b.reason);
  EXPECT_EQ(a.rival_support, b.rival_support);
  EXPECT_EQ(a.num_elsewhere, b.num_elsewhere);
}

// What a frame's views make for different numbers of threads.
void ExpectSameForAnyNumberOfThreads(const PoseContext& context,
                                     const std::vector<ViewMatches>& views) {
  std::optional<PoseOutcome> first;
  for (const std::size_t num_threads : {1, 2, 5}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, num_threads);
    const PoseOutcome outcome = EstimatePose(context, views);
    if (!first) first = outcome;
    ExpectSame(outcome, *first);
  }
}

// One candidate, some of several, all of them, and wide ones beside those.
TEST(EstimatePose, IsTheSameForAnyNumberOfThreads) {
  PoseOptions doubtful = Options(Street()), hopeless = Options(Street());
  doubtful.sure_over_chance = 1e9;
  doubtful.find_inliers = doubtful.find_firm = 100'000;
  hopeless.min_inliers = 100'000;
  for (const double y : {3.0, 14.5, 26.0, 38.0}) {
    const Rigid3 truth = Street().CamFromLocal({0.8, y, 1.6}, 10);
    const FrameFeatures frame = Street().Frame(truth, 2 * kPixelSigma, 100);
    const auto views = Street().Match(frame, 0, 5);
    std::vector<ViewMatches> poses_alone(views.rbegin(), views.rend());  // worst first
    for (ViewMatches& view : poses_alone) view = {view.view_idx, {}, {}, {}};
    for (const PoseOptions& options : {Options(Street()), doubtful, hopeless}) {
      PoseContext context = Street().Context(frame, options);
      context.last_finds = {Street().CamFromLocal({0.9, y + 0.3, 1.6}, 11), truth};
      ExpectSameForAnyNumberOfThreads(context, views);
      ExpectSameForAnyNumberOfThreads(context, poses_alone);
    }
  }
}

TEST(EstimatePose, SurvivesWrongMatches) {
  const Rigid3 truth = Street().CamFromLocal({0.8, 14, 1.6}, 10);
  const FrameFeatures frame = Street().Frame(truth, kPixelSigma, 100);
  auto views = Street().Match(frame, 0, 4);
  // Two of three matches point to the landmark of another.
  for (ViewMatches& view : views) {
    auto& c = view.correspondences;
    for (std::size_t i = 0; i + 3 < c.size(); i += 3) {
      for (const std::size_t k : {i, i + 1}) {
        c[k].point_in_map = c[k + 2].point_in_map;
        c[k].lever_in_map = c[k + 2].lever_in_map;
      }
    }
  }
  const PoseOutcome outcome = Estimate(Street(), frame, views);
  ASSERT_TRUE(outcome.found) << outcome.reason;
  EXPECT_THAT(outcome.cam_from_local.Inverse(), Rigid3Near(truth.Inverse(), kTol_rad, kTol_m));
}

// One facade alone: coplanar landmarks still fix a pose.
TEST(EstimatePose, OnePlaneIsEnough) {
  const SyntheticStreet street(StreetShape::kOneWall);
  const Rigid3 truth = street.CamFromLocal({0, 16, 1.6}, 50);
  const FrameFeatures frame = street.Frame(truth, kPixelSigma, 100);
  const PoseOutcome outcome = Estimate(street, frame, street.Match(frame, 0, 5));
  ASSERT_TRUE(outcome.found) << outcome.reason;
  EXPECT_THAT(outcome.cam_from_local.Inverse(), Rigid3Near(truth.Inverse(), kTol_rad, kTol_m));
}

// Landmarks on one line leave the turn about it open: there must be no fix.
TEST(EstimatePose, OneLineIsNotEnough) {
  const SyntheticStreet street(StreetShape::kLine, 200);
  for (const double heading_deg : {0.0, 50.0, 90.0}) {
    const FrameFeatures frame =
        street.Frame(street.CamFromLocal({0, 16, 1.6}, heading_deg), kPixelSigma, 50);
    const PoseOutcome outcome = Estimate(street, frame, street.Match(frame, 0, 5));
    EXPECT_FALSE(outcome.trusted) << heading_deg;
    EXPECT_NE(outcome.reason, "");
  }
}

TEST(EstimatePose, TooFewMatchesAreSaid) {
  const PoseOutcome none = Estimate(Street(), {}, {});
  EXPECT_FALSE(none.found);
  EXPECT_FALSE(none.trusted);
  EXPECT_EQ(none.reason, "too_few_matches");
  const FrameFeatures frame =
      Street().Frame(Street().CamFromLocal({0.8, 14, 1.6}, 10), kPixelSigma, 0);
  auto views = Street().Match(frame, 1, 1);
  ASSERT_FALSE(views.empty());
  PoseOptions options = Options(Street());
  options.use_guided = false;
  views.resize(1);
  for (const std::size_t count : {std::size_t{0}, std::size_t{3}, std::size_t{7}}) {
    ASSERT_GE(views[0].correspondences.size(), count);
    auto few = views;
    few[0].correspondences.resize(count), few[0].keypoint_idx.resize(count);
    few[0].landmark_ids.resize(count);
    const PoseOutcome outcome = Estimate(Street(), frame, few, options);
    EXPECT_FALSE(outcome.trusted);
    EXPECT_EQ(outcome.reason, "too_few_matches") << count;
  }
}

// Where no match agrees, a retrieved view's own pose is a start for the guided search.
TEST(EstimatePose, ARetrievedViewLendsItsPose) {
  const Rigid3 truth = Street().CamFromLocal({0.8, 14, 1.6}, 10);
  const FrameFeatures frame = Street().Frame(truth, kPixelSigma, 100);
  const auto estimate_from = [&](std::uint32_t panorama, std::uint32_t v) {
    ViewMatches no_matches;
    no_matches.view_idx = Street().bundle()->first_station(panorama) * kStreetViews + v;
    return Estimate(Street(), frame, {no_matches});
  };
  // The third panorama stands at 16 m and its last view looks 5 degrees to the right.
  const PoseOutcome near = estimate_from(2, 7);
  ASSERT_TRUE(near.trusted) << near.reason;
  EXPECT_THAT(near.cam_from_local.Inverse(), Rigid3Near(truth.Inverse(), kTol_rad, kTol_m));
  const PoseOutcome backwards = estimate_from(2, 3);
  EXPECT_FALSE(backwards.trusted);
  EXPECT_NE(backwards.reason, "");
}

// Two places that look the same: only the past tells them apart.
TEST(EstimatePose, LookAlikesNeedThePast) {
  const SyntheticStreet street(StreetShape::kTwins, 250);
  const Eigen::Vector3d here(0.8, 3, 1.6), there(0.8, 3 + kTwinPeriod_m, 1.6);
  const FrameFeatures frame = street.Frame(street.CamFromLocal(here, 10), kPixelSigma, 100);
  const auto views = street.Match(frame, 0, 5);
  const PoseOptions options = Options(street);
  PoseContext context = street.Context(frame, options);
  const PoseOutcome unknown = EstimatePose(context, views);
  EXPECT_FALSE(unknown.trusted);
  EXPECT_EQ(unknown.reason, "ambiguous_place");
  for (const Eigen::Vector3d& place : {here, there}) {
    const Rigid3 truth = street.CamFromLocal(place, 10);
    const Eigen::Vector3d place_in_map = street.local().ToMap(truth.Inverse().translation);
    context.prior = [&](const Eigen::Vector3d& position_in_map) {
      return (position_in_map - place_in_map).norm() < 10 ? 0.9 : 0.001;
    };
    const PoseOutcome outcome = EstimatePose(context, views);
    // The place that the past speaks for is taken, or none: the frame was taken here.
    EXPECT_TRUE(outcome.trusted || place == there) << outcome.reason;
    if (!outcome.trusted) continue;
    EXPECT_THAT(outcome.cam_from_local.Inverse(), Rigid3Near(truth.Inverse(), kTol_rad, kTol_m));
  }
}

TEST(EstimatePose, RandomMatchesGiveNoFix) {
  const FrameFeatures frame =
      Street().Frame(Street().CamFromLocal({0.8, 14, 1.6}, 10), kPixelSigma, 100);
  auto views = Street().Match(frame, 0, 4);
  Rng rng(1, "tests/random");
  for (ViewMatches& view : views) {
    for (Correspondence& c : view.correspondences) {
      c.bearing_in_cam = {rng.Uniform(-0.7, 0.7), rng.Uniform(-0.5, 0.5)};
    }
  }
  PoseOptions options = Options(Street());
  options.use_guided = false;
  const PoseOutcome outcome = Estimate(Street(), frame, views, options);
  EXPECT_FALSE(outcome.trusted);
  EXPECT_NE(outcome.reason, "");
}

// The gates, each alone, on a pose that passes all others.
TEST(EstimatePose, EachGateNamesItself) {
  const FrameFeatures frame =
      Street().Frame(Street().CamFromLocal({0.8, 14, 1.6}, 10), kPixelSigma, 0);
  const auto views = Street().Match(frame, 0, 4);
  const auto reason = [&](const std::function<void(PoseOptions*)>& change) {
    PoseOptions options = Options(Street());
    options.use_guided = false;
    change(&options);
    return Estimate(Street(), frame, views, options).reason;
  };
  EXPECT_EQ(reason([](PoseOptions*) {}), "");
  EXPECT_EQ(reason([](PoseOptions* o) { o->min_inliers = 100000; }), "too_few_inliers");
  EXPECT_EQ(reason([](PoseOptions* o) { o->min_spread = 10; }), "inliers_clustered");
  EXPECT_EQ(reason([](PoseOptions* o) { o->max_position_sigma_m = 1e-6; }), "pose_uncertain");
  EXPECT_EQ(reason([](PoseOptions* o) { o->max_chi2_per_dof = 1e-9; }), "residuals_too_large");
  EXPECT_EQ(reason([](PoseOptions* o) { o->max_distance_m = 0.1; }), "far_from_map");
  EXPECT_EQ(reason([](PoseOptions* o) { o->max_height_off_m = 0.1; }), "height_implausible");
  EXPECT_EQ(reason([](PoseOptions* o) { o->max_tilt_deg = 0; }), "tilt_implausible");
}

TEST(PoseOptions, CheckNamesTheField) {
  EXPECT_NO_THROW(PoseOptions().Check());
  PoseOptions options;
  options.min_view_inliers = 3;
  EXPECT_THROW(options.Check(), std::invalid_argument);
  options = {};
  options.min_inliers = 5;
  EXPECT_THROW(options.Check(), std::invalid_argument);
  options = {};
  options.ransac.max_reproj_error_px = -1;
  EXPECT_THROW(options.Check(), std::invalid_argument);
}

}  // namespace
}  // namespace panofix
