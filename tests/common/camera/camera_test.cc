#include "common/camera/camera.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>

#include "common/base/rng.h"

namespace panofix {
namespace {

constexpr double kRounding_px = 1e-9;
// What the header promises of Normalize.
constexpr double kNormalize = 1e-12;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

Camera Pinhole() {
  Camera camera;
  camera.width_px = 640, camera.height_px = 480;
  camera.fx_px = 520, camera.fy_px = 515, camera.cx_px = 322.5, camera.cy_px = 236.25;
  return camera;
}

Camera PlumbBob() {
  Camera camera = Pinhole();
  camera.distortion = {-0.28, 0.09, 0.0012, -0.0007, -0.015, 0, 0, 0};
  return camera;
}

Camera Rational() {
  Camera camera = Pinhole();
  camera.distortion_model = DistortionModel::kRationalPolynomial;
  camera.distortion = {0.45, 0.11, -0.0009, 0.0004, 0.006, 0.78, 0.21, 0.02};
  return camera;
}

Eigen::Vector2d ProjectWithOpenCv(const Camera& camera, const Eigen::Vector3d& x_in_cam) {
  const cv::Matx33d K(camera.fx_px, 0, camera.cx_px, 0, camera.fy_px, camera.cy_px, 0, 0, 1);
  const std::vector<double> d(camera.distortion.begin(), camera.distortion.end());
  std::vector<cv::Point2d> px;
  cv::projectPoints(std::vector<cv::Point3d>{{x_in_cam.x(), x_in_cam.y(), x_in_cam.z()}},
                    cv::Vec3d(0, 0, 0), cv::Vec3d(0, 0, 0), K, d, px);
  return {px[0].x, px[0].y};
}

TEST(Camera, ProjectIsThePinholeEquation) {
  const auto px = Pinhole().Project({1, -2, 8});
  ASSERT_TRUE(px);
  EXPECT_NEAR(px->x(), 520 * 0.125 + 322.5, kRounding_px);
  EXPECT_NEAR(px->y(), 515 * -0.25 + 236.25, kRounding_px);
}

TEST(Camera, ProjectAgreesWithOpenCv) {
  Rng rng(1, "tests/project");
  for (const Camera& camera : {Pinhole(), PlumbBob(), Rational()}) {
    for (int i = 0; i < 300; ++i) {
      const double z = rng.Uniform(0.5, 50);
      const Eigen::Vector3d x(rng.Uniform(-0.6, 0.6) * z, rng.Uniform(-0.45, 0.45) * z, z);
      const auto px = camera.Project(x);
      ASSERT_TRUE(px);
      EXPECT_LE((*px - ProjectWithOpenCv(camera, x)).norm(), kRounding_px);
    }
  }
}

TEST(Camera, NothingBehindTheCameraProjects) {
  for (const double z : {0.0, -0.0, -1.0, kNan}) EXPECT_FALSE(Pinhole().Project({0, 0, z})) << z;
}

TEST(Camera, NormalizeUndoesProjectOverTheWholeImage) {
  for (const Camera& camera : {Pinhole(), PlumbBob(), Rational()}) {
    for (double y = -0.5; y <= 479.5; y += 12) {
      for (double x = -0.5; x <= 639.5; x += 16) {
        const Eigen::Vector2d n = camera.Normalize({x, y});
        const auto px = camera.Project({n.x(), n.y(), 1});
        ASSERT_TRUE(px);
        EXPECT_LE((*px - Eigen::Vector2d(x, y)).norm(), kNormalize * 1000) << x << " " << y;
      }
    }
  }
}

TEST(Camera, NormalizeFindsTheBearing) {
  Rng rng(1, "tests/normalize");
  for (const Camera& camera : {PlumbBob(), Rational()}) {
    for (int i = 0; i < 300; ++i) {
      const Eigen::Vector2d n(rng.Uniform(-0.6, 0.6), rng.Uniform(-0.45, 0.45));
      EXPECT_LE((camera.Normalize(*camera.Project({n.x(), n.y(), 1})) - n).norm(), kNormalize);
    }
  }
}

// This model folds over at r = 1 / sqrt(3 * 0.9): pixels beyond have no bearing, but must not hang.
TEST(Camera, NormalizeEndsWhereTheModelCannotBeInverted) {
  Camera camera = Pinhole();
  camera.distortion = {-0.9, 0, 0, 0, 0, 0, 0, 0};
  (void)camera.Normalize({5000, 5000});
  const Eigen::Vector2d centre = camera.Normalize({322.5, 236.25});
  EXPECT_EQ(centre, Eigen::Vector2d::Zero());
}

TEST(Camera, FromHorizontalFovSpansIt) {
  const Camera camera = Camera::FromHorizontalFov(640, 480, 90);
  EXPECT_NEAR(camera.fx_px, 320, kRounding_px);
  EXPECT_EQ(camera.fx_px, camera.fy_px);
  // The image reaches from -0.5 to 639.5: its edges lie 45 degrees off the axis.
  EXPECT_NEAR(camera.Normalize({-0.5, 239.5}).x(), -1, kNormalize);
  EXPECT_NEAR(camera.Normalize({639.5, 239.5}).x(), 1, kNormalize);
  EXPECT_EQ(camera.Normalize({319.5, 239.5}), Eigen::Vector2d::Zero());
  EXPECT_TRUE(camera.Check().ok());
}

TEST(Camera, WithoutDistortionKeepsTheRest) {
  const Camera camera = Rational().WithoutDistortion();
  EXPECT_FALSE(camera.HasDistortion());
  EXPECT_TRUE(Rational().HasDistortion());
  EXPECT_EQ(camera.Matrix(), Rational().Matrix());
  EXPECT_EQ(camera.width_px, 640);
  EXPECT_EQ(camera.distortion_model, DistortionModel::kPlumbBob);
}

TEST(Camera, CheckNamesWhatIsWrong) {
  EXPECT_TRUE(Pinhole().Check().ok());
  const auto fault = [](const std::function<void(Camera*)>& change) {
    Camera camera = Pinhole();
    change(&camera);
    const Status status = camera.Check();
    EXPECT_EQ(status.code(), ErrorCode::kInvalidArgument);
    return status.message();
  };
  constexpr double kInf = std::numeric_limits<double>::infinity();
  EXPECT_NE(fault([](Camera* c) { c->width_px = 0; }).find("image size"), std::string::npos);
  EXPECT_NE(fault([](Camera* c) { c->height_px = -5; }).find("image size"), std::string::npos);
  EXPECT_NE(fault([](Camera* c) { c->width_px = 1 << 20; }).find("image size"), std::string::npos);
  EXPECT_NE(fault([](Camera* c) { c->fx_px = kNan; }).find("camera_matrix"), std::string::npos);
  EXPECT_NE(fault([](Camera* c) { c->cy_px = kInf; }).find("camera_matrix"), std::string::npos);
  EXPECT_NE(fault([](Camera* c) { c->fy_px = 0; }).find("focal"), std::string::npos);
  EXPECT_NE(fault([](Camera* c) { c->fx_px = -1; }).find("focal"), std::string::npos);
  EXPECT_NE(fault([](Camera* c) { c->distortion[7] = kNan; }).find("distortion"),
            std::string::npos);
}

}  // namespace
}  // namespace panofix
