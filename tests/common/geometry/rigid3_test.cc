#include "common/geometry/rigid3.h"

#include <gtest/gtest.h>

#include "common/base/rng.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_pose.h"

namespace panofix {
namespace {

constexpr double kRounding = 1e-12;  // of translations of some 100 m

Rigid3 RandomRigid(Rng* rng) {
  const Eigen::Quaterniond rotation = RandomRotation(rng);
  return {rotation, 100 * RandomNormal3(rng)};
}

TEST(Rigid3, DefaultIsTheIdentity) {
  const Eigen::Vector3d x(1, 2, 3);
  EXPECT_EQ(Rigid3() * x, x);
}

TEST(Rigid3, AgreesWithHomogeneousMatrices) {
  Rng rng(1, "tests/rigid3");
  for (int i = 0; i < 200; ++i) {
    const Rigid3 a = RandomRigid(&rng), b = RandomRigid(&rng);
    const Eigen::Vector3d x = 10 * RandomNormal3(&rng);
    const auto matrix = [](const Rigid3& t) {
      Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
      m.topLeftCorner<3, 3>() = t.rotation.toRotationMatrix();
      m.topRightCorner<3, 1>() = t.translation;
      return m;
    };
    EXPECT_LE(((a * b) * x - (matrix(a) * matrix(b) * x.homogeneous()).head<3>()).norm(),
              kRounding);
    EXPECT_LE((a.Inverse() * x - (matrix(a).inverse() * x.homogeneous()).head<3>()).norm(),
              kRounding);
    EXPECT_THAT(a * a.Inverse(), Rigid3Near(Rigid3(), 1e-7, kRounding));
  }
}

TEST(Skew, IsTheCrossProduct) {
  Rng rng(1, "tests/skew");
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3d a = RandomNormal3(&rng), b = RandomNormal3(&rng);
    EXPECT_LE((Skew(a) * b - a.cross(b)).norm(), kRounding);
  }
}

TEST(ExpSo3, IsTheMatrixExponential) {
  Rng rng(1, "tests/exp");
  for (const double angle_rad : {0.0, 1e-15, 1e-13, 1e-11, 1e-6, 0.1, 3.0}) {
    const Eigen::Vector3d omega = RandomNormal3(&rng).normalized() * angle_rad;
    // exp as its power series.
    Eigen::Matrix3d expected = Eigen::Matrix3d::Identity(), term = expected;
    for (int k = 1; k < 40; ++k) {
      term = Eigen::Matrix3d(term * Skew(omega) / k);
      expected += term;
    }
    EXPECT_LE((ExpSo3(omega).toRotationMatrix() - expected).norm(), kRounding) << angle_rad;
    EXPECT_NEAR(ExpSo3(omega).norm(), 1, 1e-15);
  }
}

TEST(AngleBetween, IgnoresTheQuaternionsSign) {
  const Eigen::Quaterniond a = ExpSo3({0.3, -0.2, 0.1});
  const Eigen::Quaterniond negative(-a.w(), -a.x(), -a.y(), -a.z());
  EXPECT_NEAR(AngleBetween(a, negative), 0, 1e-7);
  EXPECT_NEAR(AngleBetween(a, a * ExpSo3({0, 0, 0.5})), 0.5, kRounding);
}

}  // namespace
}  // namespace panofix
