#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/estimate/pnp.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_pose.h"

namespace panofix {
namespace {

// The distance equations are met to 1e-10 of the longest side.
constexpr double kReprojectionTolerance = 1e-8;
// Random triangles come near the danger cylinder, where half of the digits are lost.
constexpr double kPoseTolerance = 1e-6;

struct P3pCase {
  Rigid3 cam_from_map;
  std::array<Eigen::Vector3d, 3> rays, points;
};

P3pCase RandomCase(Rng* rng) {
  P3pCase c;
  c.cam_from_map = Rigid3(RandomRotation(rng), Eigen::Vector3d(20 * RandomNormal3(rng)));
  for (std::size_t i = 0; i < 3; ++i) {
    const double x = rng->Uniform(-1, 1), y = rng->Uniform(-1, 1), z_m = rng->Uniform(2, 40);
    const Eigen::Vector3d point_in_cam(x * z_m, y * z_m, z_m);
    c.rays[i] = point_in_cam.normalized();
    c.points[i] = c.cam_from_map.Inverse() * point_in_cam;
  }
  return c;
}

TEST(SolveP3p, HoldsTheTruthAmongItsSolutions) {
  Rng rng(1, "tests/p3p");
  constexpr int kCases = 20000;
  int found = 0;
  for (int i = 0; i < kCases; ++i) {
    const P3pCase c = RandomCase(&rng);
    const std::vector<Rigid3> poses = SolveP3p(c.rays, c.points);
    const auto near = Rigid3Near(c.cam_from_map, kPoseTolerance, 100 * kPoseTolerance);
    found += std::any_of(poses.begin(), poses.end(),
                         [&](const Rigid3& pose) { return testing::Matches(near)(pose); });
  }
  EXPECT_EQ(found, kCases);
}

TEST(SolveP3p, EverySolutionPutsThePointsOnTheirRays) {
  Rng rng(2, "tests/p3p");
  std::array<int, 5> counts{};
  for (int i = 0; i < 20000; ++i) {
    const P3pCase c = RandomCase(&rng);
    const std::vector<Rigid3> poses = SolveP3p(c.rays, c.points);
    ASSERT_LE(poses.size(), 4U);
    ++counts[poses.size()];
    for (const Rigid3& pose : poses) {
      for (std::size_t k = 0; k < 3; ++k) {
        const Eigen::Vector3d point = pose * c.points[k];
        EXPECT_GT(point.dot(c.rays[k]), 0);
        EXPECT_LT(point.normalized().cross(c.rays[k]).norm(), kReprojectionTolerance);
      }
    }
  }
  // The problem has up to four solutions, and a solver that drops some would show here.
  EXPECT_GT(counts[1] + counts[2], 10000);
  EXPECT_GT(counts[4], 50);
}

TEST(SolveP3p, FourSolutionsOfTheSymmetricPyramid) {
  // Equilateral triangle seen along its axis (Fischler and Bolles, 1981): the axis itself and three
  // reflections, where the cosine of the apex angle allows them.
  std::array<Eigen::Vector3d, 3> points, rays;
  for (std::size_t i = 0; i < 3; ++i) {
    const double angle = 2 * M_PI * static_cast<double>(i) / 3;
    points[i] = {std::cos(angle), std::sin(angle), 0};
    rays[i] = (points[i] + Eigen::Vector3d(0, 0, 2)).normalized();
  }
  const std::vector<Rigid3> poses = SolveP3p(rays, points);
  EXPECT_EQ(poses.size(), 4U);
  EXPECT_THAT(poses,
              testing::Contains(Rigid3Near(
                  Rigid3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, 2)), 1e-6, 1e-6)));
}

TEST(SolveP3p, DegenerateTrianglesHaveNoPose) {
  const std::array<Eigen::Vector3d, 3> rays = {Eigen::Vector3d(0, 0, 1),
                                               Eigen::Vector3d(0.1, 0, 1).normalized(),
                                               Eigen::Vector3d(0.2, 0, 1).normalized()};
  const Eigen::Vector3d p(1, 2, 3), d(0.5, 0.1, -0.2);
  EXPECT_TRUE(SolveP3p(rays, {p, p + d, p + 2 * d}).empty());
  EXPECT_TRUE(SolveP3p(rays, {p, p, p + d}).empty());
  EXPECT_TRUE(SolveP3p(rays, {p, p, p}).empty());
  EXPECT_TRUE(
      SolveP3p({rays[0], rays[0], rays[1]}, {p, p + d, p + Eigen::Vector3d(0, 1, 0)}).empty());
}

TEST(SolveP3p, HostileNumbersHaveNoPose) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double inf = std::numeric_limits<double>::infinity();
  Rng rng(3, "tests/p3p");
  for (const double bad : {nan, inf, -inf}) {
    for (std::size_t k = 0; k < 3; ++k) {
      P3pCase c = RandomCase(&rng);
      c.points[k].y() = bad;
      EXPECT_TRUE(SolveP3p(c.rays, c.points).empty());
      c = RandomCase(&rng);
      c.rays[k].x() = bad;
      EXPECT_TRUE(SolveP3p(c.rays, c.points).empty());
    }
  }
}

}  // namespace
}  // namespace panofix
