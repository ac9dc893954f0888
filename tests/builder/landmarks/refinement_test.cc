// The joint refinement on streets whose truth is known.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <numeric>
#include <stdexcept>

#include "tests/builder/landmarks/street.h"
#include "tests/support/matchers.h"

namespace panofix {
namespace {

constexpr std::uint64_t kNumStreets = 4;

LandmarkLayer Build(const Street& street, bool refine = true) {
  LandmarkOptions options;
  options.max_per_view = 0;
  options.refine = refine;
  return BuildLandmarks(street.panoramas, street.observations, street.errors, street.focal_px,
                        options);
}

// Mean square errors of what neighbours' relative poses and planes are.
struct Errors {
  double position_sq = 0, turn_sq = 0, distance_sq = 0;
  int num_pairs = 0, num_planes = 0;
  double Position() const { return std::sqrt(position_sq / num_pairs); }
  double Turn() const { return std::sqrt(turn_sq / num_pairs); }
  double Distance() const { return std::sqrt(distance_sq / num_planes); }
};

// Planes 1 to 3 only: the ends of the street are out of most panoramas' sight.
void AddErrors(const Street& street, std::size_t p, const Rigid3& a, const Rigid3& b,
               const std::vector<DepthPlane>& planes, Errors* errors) {
  const Rigid3 estimated = a.Inverse() * b;
  const Rigid3 truth =
      street.true_local_from_pano[p].Inverse() * street.true_local_from_pano[p + 1];
  errors->position_sq += (estimated.translation - truth.translation).squaredNorm();
  errors->turn_sq += std::pow(AngleBetween(estimated.rotation, truth.rotation), 2);
  ++errors->num_pairs;
  for (std::size_t k = 1; k <= 3 && k < planes.size(); ++k) {
    errors->distance_sq += std::pow(double{planes[k].d_m / street.true_planes[p][k].d_m} - 1, 2);
    ++errors->num_planes;
  }
}

void AddBoth(const Street& street, const LandmarkLayer& layer, Errors* before, Errors* after) {
  for (std::size_t p = 0; p + 1 < street.panoramas.size(); ++p) {
    const auto &one = street.panoramas[p], &next = street.panoramas[p + 1];
    AddErrors(street, p, one.local_from_pano, next.local_from_pano, one.planes, before);
    AddErrors(street, p, layer.panoramas[p].local_from_pano, layer.panoramas[p + 1].local_from_pano,
              layer.panoramas[p].planes, after);
  }
}

TEST(Refinement, RecoversGeotagAndPlaneErrors) {
  Errors before, after;
  for (std::uint64_t seed = 1; seed <= kNumStreets; ++seed) {
    const Street street = MakeStreet({}, seed);
    const LandmarkLayer layer = Build(street);
    AddBoth(street, layer, &before, &after);
    for (const PanoramaRefinement& p : layer.panoramas) {
      EXPECT_FALSE(p.is_flagged);
      EXPECT_GT(p.num_tracks, 50);
      EXPECT_LT(p.residual_after_px, 0.5 * p.residual_before_px);
    }
  }
  // Geotags of 5 cm put neighbours 12 cm off; hundreds of bearings of 2 mrad settle it to 1 cm.
  EXPECT_LT(after.Position(), 0.02);
  EXPECT_LT(after.Position(), before.Position() / 5);
  EXPECT_LT(after.Turn(), before.Turn() / 4);
  // What is seen best of a 2 % plane error; the scale itself hangs on the geotags' baseline.
  EXPECT_LT(after.Distance(), before.Distance() / 1.8);
}

TEST(Refinement, AFifthOfWrongSightsDoesNotRuinIt) {
  StreetOptions options;
  options.outlier_share = 0.2;
  Errors before, after;
  for (std::uint64_t seed = 1; seed <= kNumStreets; ++seed) {
    const Street street = MakeStreet(options, seed);
    AddBoth(street, Build(street), &before, &after);
  }
  EXPECT_LT(after.Position(), 0.025);
  EXPECT_LT(after.Position(), before.Position() / 4);
}

// Normalised squared errors of the landmarks' points in their anchors' true frames.
struct Nees {
  double range = 0, across = 0;
  int num = 0;
  void Add(const Street& street, const Landmark& landmark) {
    const Rigid3 pano_from_local = street.true_local_from_pano[landmark.panorama].Inverse();
    const Eigen::Vector3d truth =
        pano_from_local * street.points_in_local[PointOf(street, landmark)];
    const Eigen::Vector3d error = landmark.point_in_pano.cast<double>() - truth;
    const double along_m = error.dot(truth.normalized());
    range += std::pow(along_m / double{landmark.range_sigma_m}, 2);
    across +=
        (error.squaredNorm() - along_m * along_m) / 2 / std::pow(double{landmark.point_sigma_m}, 2);
    ++num;
  }
};

TEST(Refinement, LandmarksAreAsGoodAsTheySay) {
  Nees joined, single;
  for (std::uint64_t seed = 1; seed <= kNumStreets; ++seed) {
    const Street street = MakeStreet({}, seed);
    for (const Landmark& l : Build(street).landmarks)
      (l.num_panoramas > 1 ? joined : single).Add(street, l);
  }
  // 1 is perfect. Hundreds of landmarks, yet their planes' errors are shared by many: wide bounds.
  for (const Nees* nees : {&joined, &single}) {
    ASSERT_GT(nees->num, 300);
    EXPECT_GT(nees->range / nees->num, 0.4);
    // Poses keep more of their geotags' errors where tracks are trusted less than they deserve
    // here.
    EXPECT_LT(nees->range / nees->num, 2.5);
    EXPECT_GT(nees->across / nees->num, 0.4);
    EXPECT_LT(nees->across / nees->num, 1.6);
  }
}

TEST(Refinement, SharpensPointsFromWhatPanoramasSayAlone) {
  const Street street = MakeStreet({}, 1);
  const auto rms_m = [&](const LandmarkLayer& layer) {
    double sq = 0;
    int num = 0;
    for (const Landmark& l : layer.landmarks) {
      if (l.num_panoramas < 2) continue;
      const Rigid3& pose = layer.panoramas[l.panorama].local_from_pano;
      sq += (pose * l.point_in_pano.cast<double>() - street.points_in_local[PointOf(street, l)])
                .squaredNorm();
      ++num;
    }
    return std::sqrt(sq / num);
  };
  EXPECT_LT(rms_m(Build(street)), 0.8 * rms_m(Build(street, false)));
}

TEST(Refinement, AFaultyGeotagIsFlaggedAndHarmsNoOne) {
  for (std::uint64_t seed = 1; seed <= kNumStreets; ++seed) {
    Street street = MakeStreet({}, seed);
    const LandmarkLayer sound = Build(street);
    street.panoramas[2].local_from_pano.translation += Eigen::Vector3d(2.4, 1.8, 0);  // 3 m
    const LandmarkLayer layer = Build(street);
    for (std::size_t p = 0; p < layer.panoramas.size(); ++p) {
      EXPECT_EQ(layer.panoramas[p].is_flagged, p == 2) << seed << ' ' << p;
    }
    EXPECT_THAT(layer.panoramas[2].local_from_pano,
                Rigid3Near(street.panoramas[2].local_from_pano, 0, 0));
    // With the middle one gone, its neighbours are tied 16 m apart and less firmly.
    for (const std::size_t p : {0U, 1U, 3U, 4U}) {
      EXPECT_THAT(layer.panoramas[p].local_from_pano,
                  Rigid3Near(sound.panoramas[p].local_from_pano, 0.002, 0.06));
    }
    for (const Landmark& l : layer.landmarks) {
      EXPECT_TRUE(l.panorama != 2 || l.point_sigma_m > 0.5F);
    }
  }
}

TEST(Refinement, AFaultWithinReachIsFlaggedByItsShift) {
  Street street = MakeStreet({}, 2);
  LandmarkOptions options;
  options.max_shift_m = 0.15;
  street.panoramas[2].local_from_pano.translation += Eigen::Vector3d(0, 0, 0.3);
  const LandmarkLayer layer = BuildLandmarks(street.panoramas, street.observations, street.errors,
                                             street.focal_px, options);
  EXPECT_TRUE(layer.panoramas[2].is_flagged);
  EXPECT_EQ(layer.panoramas[2].local_from_pano.translation,
            street.panoramas[2].local_from_pano.translation);
  for (const std::size_t p : {0U, 1U, 3U, 4U}) EXPECT_FALSE(layer.panoramas[p].is_flagged);
}

TEST(Refinement, AFixedPanoramaHelpsButStays) {
  Street street = MakeStreet({}, 1);
  street.panoramas[0].is_fixed = true;
  street.panoramas[0].local_from_pano = street.true_local_from_pano[0];
  const LandmarkLayer layer = Build(street);
  EXPECT_EQ(layer.panoramas[0].local_from_pano.translation,
            street.true_local_from_pano[0].translation);
  EXPECT_EQ(layer.panoramas[0].local_from_pano.rotation.coeffs(),
            street.true_local_from_pano[0].rotation.coeffs());
  EXPECT_FLOAT_EQ(layer.panoramas[0].planes[1].d_m, street.panoramas[0].planes[1].d_m);
  EXPECT_GT(layer.panoramas[0].num_tracks, 50);
  // Tied to one that stands right, its neighbour does too.
  EXPECT_THAT(layer.panoramas[1].local_from_pano,
              Rigid3Near(street.true_local_from_pano[1], 0.002, 0.03));
}

TEST(Refinement, WithoutTracksNothingMoves) {
  StreetOptions options;
  options.spacing_m = 50;  // beyond what neighbours are
  options.num_panoramas = 3;
  const Street street = MakeStreet(options, 1);
  const LandmarkLayer layer = Build(street);
  ASSERT_GT(layer.landmarks.size(), 50U);
  for (std::size_t p = 0; p < 3; ++p) {
    EXPECT_EQ(layer.panoramas[p].local_from_pano.translation,
              street.panoramas[p].local_from_pano.translation);
    EXPECT_EQ(layer.panoramas[p].local_from_pano.rotation.coeffs(),
              street.panoramas[p].local_from_pano.rotation.coeffs());
    EXPECT_EQ(layer.panoramas[p].planes[1].normal_in_pano,
              street.panoramas[p].planes[1].normal_in_pano);
    EXPECT_FLOAT_EQ(layer.panoramas[p].distance_sigma_share[1], 0.02F);
    EXPECT_EQ(layer.panoramas[p].num_tracks, 0);
  }
}

TEST(Refinement, RastersAreRefinedByBearingsAlone) {
  StreetOptions options;
  options.planes_are_known = false;
  Errors before, after;
  for (std::uint64_t seed = 1; seed <= kNumStreets; ++seed) {
    const Street street = MakeStreet(options, seed);
    const LandmarkLayer layer = Build(street);
    AddBoth(street, layer, &before, &after);
    for (const Landmark& l : layer.landmarks) EXPECT_EQ(l.surface_idx, 0);
  }
  EXPECT_LT(after.Position(), before.Position() / 2.5);
}

TEST(BuildLandmarks, OrderAndThreadsDoNotMatter) {
  Street street = MakeStreet({}, 1);
  LandmarkOptions options;
  options.max_per_view = 20;
  const auto build = [&](const std::vector<LandmarkObservation>& observations) {
    return Bytes(
        BuildLandmarks(street.panoramas, observations, street.errors, street.focal_px, options));
  };
  const auto expected = build(street.observations);
  std::vector<std::size_t> order(street.observations.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  Rng rng(1, "test/shuffle");
  for (std::size_t i = order.size() - 1; i > 0; --i) std::swap(order[i], order[rng.Below(i + 1)]);
  std::vector<LandmarkObservation> shuffled;
  for (const std::size_t i : order) shuffled.push_back(street.observations[i]);
  EXPECT_EQ(build(shuffled), expected);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  EXPECT_EQ(build(street.observations), expected);
}

TEST(BuildLandmarks, FarFromTheOriginAllIsTheSame) {
  Street street = MakeStreet({}, 1);
  const LandmarkLayer here = Build(street);
  const Eigen::Vector3d far(652000, 6861000, 80);  // what a national grid looks like
  for (LandmarkPanorama& p : street.panoramas) p.local_from_pano.translation += far;
  const LandmarkLayer there = Build(street);
  ASSERT_EQ(there.landmarks.size(), here.landmarks.size());
  for (std::size_t p = 0; p < here.panoramas.size(); ++p) {
    Rigid3 moved = here.panoramas[p].local_from_pano;
    moved.translation += far;
    EXPECT_THAT(there.panoramas[p].local_from_pano, Rigid3Near(moved, 1e-6, 1e-5));
  }
}

TEST(BuildLandmarks, NothingAndOnePanoramaAreNoErrors) {
  const LandmarkLayer nothing = BuildLandmarks({}, {}, MapErrors{}, 500, {});
  EXPECT_TRUE(nothing.landmarks.empty());
  EXPECT_TRUE(nothing.panoramas.empty());
  StreetOptions options;
  options.num_panoramas = 1;
  const Street street = MakeStreet(options, 1);
  const LandmarkLayer layer = Build(street);
  EXPECT_EQ(layer.landmarks.size(), street.observations.size() / 2);  // two views a point
  EXPECT_EQ(layer.panoramas[0].local_from_pano.translation,
            street.panoramas[0].local_from_pano.translation);
}

TEST(BuildLandmarks, BadPosesAndFocalLengthsAreTheCallersFault) {
  Street street = MakeStreet({}, 1);
  const auto build = [&](double focal_px) {
    return BuildLandmarks(street.panoramas, street.observations, street.errors, focal_px, {});
  };
  EXPECT_THROW((void)build(0), std::logic_error);
  street.panoramas[1].local_from_pano.translation.x() = std::nan("");
  EXPECT_THROW((void)build(500), std::logic_error);
}

}  // namespace
}  // namespace panofix
