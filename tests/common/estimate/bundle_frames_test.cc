// The local bundle adjustment over several frames: a street with two façades, seen by a camera that
// drives along; panoramas, façades and points have errors drawn from the estimator's own model.

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "common/estimate/bundle_residual.h"
#include "common/estimate/refine.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_pose.h"

namespace panofix {
namespace {

struct StreetOptions {
  int num_frames = 3;                 // 1.5 m apart
  int matches_a_frame = 90;           // of all panoramas together
  double newest_share_of_others = 1;  // in the newest frame, of what all but panorama 0 have
  double noise = 1;                   // scales every error that is drawn
  double pixel_sigma = 0.7;
  double position_sigma_m = 0.1, angle_sigma_rad = 0.004;
  double distance_sigma = 0.02, normal_sigma_rad = 0.02, own_sigma = 0.015;
};

struct Street {
  std::vector<Rigid3> cam_from_map;  // the truth, newest last
  std::vector<Rigid3> start;         // refined with the panoramas as they are
  std::vector<std::vector<Correspondence>> matches;
  std::vector<PanoramaPrior> priors;
  [[nodiscard]] std::vector<BundleFrame> Frames(std::size_t most) const {
    std::vector<BundleFrame> frames;
    for (std::size_t f = cam_from_map.size() - most; f < cam_from_map.size(); ++f)
      frames.push_back({start[f], matches[f]});
    return frames;
  }
};

constexpr int kPanoramas = 3, kSides = 2;
constexpr double kFacade_m = 8, kFocal_px = 500;

// A point as the map has it and as it is.
struct StreetPoint {
  Correspondence mapped;
  Eigen::Vector3d truth;
};

class StreetMaker {
 public:
  StreetMaker(const StreetOptions& options, std::uint64_t seed)
      : options_(options), rng_(seed, "tests/street") {
    for (int p = 0; p < kPanoramas; ++p) {
      Vector6d delta;
      delta << options_.noise * options_.position_sigma_m * RandomNormal3(&rng_),
          options_.noise * options_.angle_sigma_rad * RandomNormal3(&rng_);
      motions_.emplace_back(delta);
      for (int side = 0; side < kSides; ++side) {
        Eigen::Vector3d error = options_.normal_sigma_rad * RandomNormal3(&rng_);
        error.x() = options_.distance_sigma * rng_.Normal();
        surfaces_.push_back(options_.noise * error);
      }
    }
  }

  // Any point of a façade that a panorama vouches for.
  StreetPoint Point(int panorama) {
    const int side = static_cast<int>(rng_.Below(kSides));
    const double y_m = side == 0 ? kFacade_m : -kFacade_m;
    StreetPoint point;
    Correspondence& m = point.mapped;
    m.panorama_idx = panorama;
    m.lever_in_map = {rng_.Uniform(-2, 25), y_m, rng_.Uniform(-2, 8)};
    m.point_in_map = Eigen::Vector3d(6.0 * panorama, 1, 2.5) + m.lever_in_map;
    m.surface_id = 256 * panorama + side;
    m.surface_normal_in_map = Eigen::Vector3d(0, side == 0 ? 1 : -1, 0);
    m.surface_distance_sigma = options_.distance_sigma;
    m.surface_normal_sigma_rad = options_.normal_sigma_rad;
    m.keypoint_sigma = options_.pixel_sigma / kFocal_px;
    const Eigen::RowVector3d row = SurfaceRow(m);
    const double shared =
        std::hypot(options_.distance_sigma, options_.normal_sigma_rad * row.tail<2>().norm());
    m.range_sigma_in_map = std::hypot(options_.own_sigma, shared) * m.lever_in_map;
    const auto p = static_cast<std::size_t>(panorama);
    const Eigen::Vector3d& surface = surfaces_[kSides * p + static_cast<std::size_t>(side)];
    point.truth = MovedPoint(BundleMatch(m), motions_[p], surface) +
                  options_.noise * options_.own_sigma * rng_.Normal() * m.lever_in_map;
    return point;
  }

  Street Make() {
    Street street;
    for (int p = 0; p < kPanoramas; ++p) {
      street.priors.push_back(
          {p, options_.position_sigma_m, options_.angle_sigma_rad, options_.angle_sigma_rad});
    }
    // Looks along x; every frame sees the same points as far as its picture reaches.
    Eigen::Matrix3d map_from_cam;
    map_from_cam << 0, 0, 1, -1, 0, 0, 0, -1, 0;
    for (int f = 0; f < options_.num_frames; ++f) {
      street.cam_from_map.push_back(
          Rigid3(map_from_cam, Eigen::Vector3d(1.5 * f, rng_.Uniform(-0.3, 0.3), 1.6)).Inverse());
    }
    street.matches.resize(street.cam_from_map.size());
    for (int k = 0; k < 6 * options_.matches_a_frame; ++k) {
      const StreetPoint point = Point(k % kPanoramas);
      const double draw = rng_.Uniform();
      for (std::size_t f = 0; f < street.matches.size(); ++f) {
        const bool newest = f + 1 == street.matches.size();
        if (newest && k % kPanoramas != 0 && draw > options_.newest_share_of_others) continue;
        Observe(point, street.cam_from_map[f], &street.matches[f]);
      }
    }
    for (std::size_t f = 0; f < street.matches.size(); ++f) {
      street.start.push_back(
          RefinePose(street.matches[f], street.cam_from_map[f], {}).cam_from_map);
    }
    return street;
  }

 private:
  void Observe(const StreetPoint& point, const Rigid3& cam_from_map,
               std::vector<Correspondence>* matches) {
    const Eigen::Vector3d x = cam_from_map * point.truth;
    const Eigen::Vector2d noise(rng_.Normal(), rng_.Normal());
    const Eigen::Vector2d bearing = x.head<2>() / x.z();
    const bool visible = x.z() > 4 && std::abs(bearing.x()) < 0.64 && std::abs(bearing.y()) < 0.48;
    if (!visible || static_cast<int>(matches->size()) == options_.matches_a_frame) return;
    matches->push_back(point.mapped);
    matches->back().bearing_in_cam =
        bearing + options_.noise * options_.pixel_sigma / kFocal_px * noise;
  }

  const StreetOptions options_;
  Rng rng_;
  std::vector<PanoramaMotion> motions_;
  std::vector<Eigen::Vector3d> surfaces_;  // kSides a panorama
};

Street MakeStreet(const StreetOptions& options, std::uint64_t seed) {
  return StreetMaker(options, seed).Make();
}

BundleOptions AllMatches() {
  BundleOptions options;
  options.max_matches_per_past_frame = 1000;
  return options;
}

double Nees(const BundleResult& result, const Rigid3& truth) {
  const Vector6d e = PoseError(result.cam_from_map, truth);
  return e.dot(result.covariance.ldlt().solve(e));
}

TEST(LocalBundleAdjustmentOfFrames, OneFrameIsTheFrameAlone) {
  const Street street = MakeStreet({}, 1);
  const BundleResult one = LocalBundleAdjustment(street.Frames(1), street.priors, {});
  const BundleResult alone =
      LocalBundleAdjustment(street.matches.back(), street.start.back(), street.priors, {});
  ASSERT_TRUE(one.success && alone.success);
  EXPECT_EQ(one.cam_from_map.translation, alone.cam_from_map.translation);
  EXPECT_EQ(one.covariance, alone.covariance);
  EXPECT_EQ(one.num_past_frames, 0);
}

// At the exact solution every weight is one and every correction zero: the information of all
// variables together is assembled from numeric derivatives and inverted as one dense matrix.
TEST(LocalBundleAdjustmentOfFrames, MarginalCovarianceEqualsTheDenseInverse) {
  constexpr double kStep = 1e-6, kTolerance = 1e-5;
  StreetOptions options;
  options.noise = 0;
  const Street street = MakeStreet(options, 2);
  const std::vector<BundleFrame> frames = street.Frames(2);
  const BundleResult result = LocalBundleAdjustment(frames, street.priors, AllMatches());
  ASSERT_TRUE(result.success);
  ASSERT_EQ(result.num_past_frames, 1);
  constexpr Eigen::Index kFrames = 12, kSurfaceStart = kFrames + 6 * kPanoramas;
  constexpr Eigen::Index kSize = kSurfaceStart + 3 * kPanoramas * kSides;
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(kSize, kSize);
  for (Eigen::Index p = 0; p < kPanoramas; ++p) {
    auto diagonal = information.diagonal().segment<6>(kFrames + 6 * p);
    diagonal.head<3>().setConstant(std::pow(options.position_sigma_m, -2));
    diagonal.tail<3>().setConstant(std::pow(options.angle_sigma_rad, -2));
  }
  for (Eigen::Index s = 0; s < kPanoramas * kSides; ++s) {
    information.diagonal().segment<3>(kSurfaceStart + 3 * s) =
        Eigen::Vector3d(options.distance_sigma, options.normal_sigma_rad, options.normal_sigma_rad)
            .cwiseAbs2()
            .cwiseInverse();
  }
  for (std::size_t f = 0; f < frames.size(); ++f) {
    for (const Correspondence& m : frames[f].matches) {
      const BundleMatch match(WithoutSharedError(m));
      const Eigen::Matrix2d whitener =
          SqrtInformation(ResidualCovariance(match.match, frames[f].cam_from_map));
      const Eigen::Index surface = kSides * m.panorama_idx + m.surface_id % 256;
      const auto residual_at = [&](const Eigen::VectorXd& x) {
        const CameraFrame camera(
            PerturbPose(frames[f].cam_from_map, x.segment<6>(6 * static_cast<Eigen::Index>(f))));
        Eigen::Vector2d residual;
        EXPECT_TRUE(BundleResidual(match, whitener, camera,
                                   PanoramaMotion(x.segment<6>(kFrames + 6 * m.panorama_idx)),
                                   x.segment<3>(kSurfaceStart + 3 * surface), &residual));
        return residual;
      };
      Eigen::MatrixXd jacobian(2, kSize);
      for (Eigen::Index k = 0; k < kSize; ++k) {
        const Eigen::VectorXd step = kStep * Eigen::VectorXd::Unit(kSize, k);
        jacobian.col(k) = (residual_at(step) - residual_at(-step)) / (2 * kStep);
      }
      information += jacobian.transpose() * jacobian;
    }
  }
  const Eigen::MatrixXd dense = information.ldlt().solve(Eigen::MatrixXd::Identity(kSize, kSize));
  const Matrix6d expected = dense.block<6, 6>(6, 6);
  const Vector6d scale = expected.diagonal().cwiseSqrt().cwiseInverse();
  const Matrix6d difference =
      scale.asDiagonal() * (result.covariance - expected) * scale.asDiagonal();
  EXPECT_LT(difference.norm(), kTolerance);
  EXPECT_THAT(result.cam_from_map.Inverse(),
              Rigid3Near(street.cam_from_map.back().Inverse(), 1e-6, 1e-5));
}

TEST(LocalBundleAdjustmentOfFrames, IsCalibrated) {
  constexpr int kTrials = 200;
  // Chi-square's mean over 200 trials of 6 is known to 4 %; the rest is Tukey's and the planes' own
  // share, which is kept above zero.
  constexpr double kTolerance = 0.2;
  for (const std::size_t num_frames : {1, 2, 3}) {
    double mean = 0;
    int num_past = 0;
    for (std::uint64_t trial = 0; trial < kTrials; ++trial) {
      const Street street = MakeStreet({}, 100 + trial);
      const BundleResult result =
          LocalBundleAdjustment(street.Frames(num_frames), street.priors, AllMatches());
      ASSERT_TRUE(result.success);
      num_past += result.num_past_frames;
      mean += Nees(result, street.cam_from_map.back()) / kTrials;
    }
    EXPECT_GE(num_past, 0.98 * static_cast<double>(kTrials * (num_frames - 1)));
    EXPECT_NEAR(mean / 6, 1.0, kTolerance) << num_frames << " frames";
  }
}

// The newest frame sees panorama 0 and little else, the past ones see all three: what moves
// panorama 0 against the others they tell.
TEST(LocalBundleAdjustmentOfFrames, PastFramesHelpWherePanoramaErrorsDominate) {
  constexpr std::uint64_t kTrials = 100;
  StreetOptions options;
  options.newest_share_of_others = 0.03;
  options.angle_sigma_rad = 0.001;
  std::vector<double> mean_m(3), mean_sigma_m(3);
  for (std::uint64_t trial = 0; trial < kTrials; ++trial) {
    const Street street = MakeStreet(options, 500 + trial);
    for (std::size_t n = 1; n <= 3; ++n) {
      const BundleResult result =
          LocalBundleAdjustment(street.Frames(n), street.priors, AllMatches());
      ASSERT_TRUE(result.success);
      mean_m[n - 1] +=
          PoseError(result.cam_from_map, street.cam_from_map.back()).head<3>().norm() / kTrials;
      mean_sigma_m[n - 1] += std::sqrt(result.covariance.topLeftCorner<3, 3>().trace()) / kTrials;
    }
  }
  RecordProperty("mean_m", std::to_string(mean_m[0]) + " " + std::to_string(mean_m[1]) + " " +
                               std::to_string(mean_m[2]));
  EXPECT_LT(mean_m[1], 0.9 * mean_m[0]);
  EXPECT_LT(mean_sigma_m[1], 0.95 * mean_sigma_m[0]);
  EXPECT_LE(mean_m[2], 1.02 * mean_m[1]);
}

// How far the newest frame's position is moved, over its 3-D sigma, by a past frame put in as
// given.
double ShiftBy(const Street& street, const BundleFrame& past, int* num_past_frames) {
  const BundleResult alone = LocalBundleAdjustment(street.Frames(1), street.priors, {});
  const std::vector<BundleFrame> frames = {past, street.Frames(1)[0]};
  const BundleResult both = LocalBundleAdjustment(frames, street.priors, {});
  EXPECT_TRUE(alone.success && both.success);
  *num_past_frames = both.num_past_frames;
  const Eigen::Vector3d shift =
      both.cam_from_map.Inverse().translation - alone.cam_from_map.Inverse().translation;
  return shift.norm() / std::sqrt(alone.covariance.topLeftCorner<3, 3>().trace());
}

TEST(LocalBundleAdjustmentOfFrames, AWrongPastFrameDoesNotDrag) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const Street street = MakeStreet({}, 900 + seed);
    Rng rng(seed, "tests/wrong_past_frame");
    BundleFrame past = street.Frames(2)[0];
    Vector6d off = Vector6d::Zero();
    off.head<3>() = RandomNormal3(&rng).normalized();  // a metre
    past.cam_from_map = PerturbPose(past.cam_from_map, off);
    int num_past = 0;
    EXPECT_LT(ShiftBy(street, past, &num_past), 1) << seed;
    // Matches that belong to points elsewhere, in a frame that claims to be right.
    past = street.Frames(2)[0];
    std::vector<Correspondence> shuffled(past.matches.begin(), past.matches.end());
    for (std::size_t i = 0; i + 1 < shuffled.size(); i += 2)
      std::swap(shuffled[i].bearing_in_cam, shuffled[i + 1].bearing_in_cam);
    past.matches = shuffled;
    EXPECT_LT(ShiftBy(street, past, &num_past), 1) << seed;
    EXPECT_EQ(num_past, 0) << seed;
    // A consensus that is wrong as a whole: windows of the façades taken for the next ones.
    past = street.Frames(2)[0];
    std::vector<Correspondence> displaced(past.matches.begin(), past.matches.end());
    for (Correspondence& m : displaced) m.point_in_map.x() += 1, m.lever_in_map.x() += 1;
    past = {PerturbPose(past.cam_from_map, Vector6d::Unit(0)), displaced};
    EXPECT_LT(ShiftBy(street, past, &num_past), 1) << seed;
  }
}

TEST(LocalBundleAdjustmentOfFrames, UsesAsManyPastMatchesAsAllowed) {
  const Street street = MakeStreet({}, 3);
  const auto covariance_with = [&](int most) {
    BundleOptions options;
    options.max_matches_per_past_frame = most;
    const BundleResult result = LocalBundleAdjustment(street.Frames(3), street.priors, options);
    EXPECT_TRUE(result.success);
    EXPECT_EQ(result.num_past_frames, most > 0 ? 2 : 0);
    return Eigen::MatrixXd(result.covariance);
  };
  EXPECT_EQ(covariance_with(0),
            LocalBundleAdjustment(street.Frames(1), street.priors, {}).covariance);
  EXPECT_LT(covariance_with(60).trace(), covariance_with(0).trace());
  EXPECT_EQ(covariance_with(90), covariance_with(1000));
}

TEST(LocalBundleAdjustmentOfFrames, SameInputSameBits) {
  const Street street = MakeStreet({}, 4), again = MakeStreet({}, 4);
  const std::vector<double> ballast(100000, 1.0);  // other heap addresses
  const BundleResult a = LocalBundleAdjustment(street.Frames(3), street.priors, {});
  const BundleResult b = LocalBundleAdjustment(again.Frames(3), again.priors, {});
  EXPECT_EQ(a.cam_from_map.translation, b.cam_from_map.translation);
  EXPECT_EQ(a.cam_from_map.rotation.coeffs(), b.cam_from_map.rotation.coeffs());
  EXPECT_EQ(a.covariance, b.covariance);
}

TEST(LocalBundleAdjustmentOfFrames, HostileFramesAreLeftOut) {
  const Street street = MakeStreet({}, 5);
  const BundleResult alone = LocalBundleAdjustment(street.Frames(1), street.priors, {});
  std::vector<BundleFrame> frames = street.Frames(3);
  frames[0].cam_from_map.translation.x() = std::numeric_limits<double>::quiet_NaN();
  frames[1].matches = {};
  const BundleResult result = LocalBundleAdjustment(frames, street.priors, {});
  ASSERT_TRUE(result.success);
  EXPECT_EQ(result.num_past_frames, 0);
  EXPECT_EQ(result.covariance, alone.covariance);
  // The newest is the one that counts.
  std::swap(frames[1], frames[2]);
  EXPECT_FALSE(LocalBundleAdjustment(frames, street.priors, {}).success);
  EXPECT_FALSE(LocalBundleAdjustment(std::span<const BundleFrame>{}, street.priors, {}).success);
  // A surface id that two panoramas claim does not mix them.
  Street mixed = MakeStreet({}, 5);
  for (std::vector<Correspondence>& matches : mixed.matches)
    for (Correspondence& m : matches) m.surface_id = 7;
  EXPECT_TRUE(LocalBundleAdjustment(mixed.Frames(3), mixed.priors, {}).success);
}

}  // namespace
}  // namespace panofix
