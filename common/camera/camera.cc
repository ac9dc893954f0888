#include "common/camera/camera.h"

#include <cmath>

#include "common/base/log.h"

namespace panofix {
namespace {

// OpenCV's model: x' = x * radial + tangential, Jacobian by the closed form.
Eigen::Vector2d Distort(const Camera& camera, const Eigen::Vector2d& n, Eigen::Matrix2d* jacobian) {
  const auto& d = camera.distortion;
  const double k1 = d[0], k2 = d[1], p1 = d[2], p2 = d[3], k3 = d[4], k4 = d[5], k5 = d[6],
               k6 = d[7];
  const double x = n.x(), y = n.y(), r2 = x * x + y * y;
  const double numerator = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  const double denominator = 1 + r2 * (k4 + r2 * (k5 + r2 * k6));
  const double radial = numerator / denominator;
  if (jacobian != nullptr) {
    const double numerator_dr2 = k1 + r2 * (2 * k2 + r2 * 3 * k3);
    const double denominator_dr2 = k4 + r2 * (2 * k5 + r2 * 3 * k6);
    const double radial_dr2 = (numerator_dr2 - radial * denominator_dr2) / denominator;
    (*jacobian)(0, 0) = radial + 2 * x * x * radial_dr2 + 2 * p1 * y + 6 * p2 * x;
    (*jacobian)(0, 1) = 2 * x * y * radial_dr2 + 2 * p1 * x + 2 * p2 * y;
    (*jacobian)(1, 0) = 2 * x * y * radial_dr2 + 2 * p1 * x + 2 * p2 * y;
    (*jacobian)(1, 1) = radial + 2 * y * y * radial_dr2 + 6 * p1 * y + 2 * p2 * x;
  }
  return {x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
          y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y};
}

}  // namespace

Camera Camera::FromHorizontalFov(int width_px, int height_px, double hfov_deg) {
  Camera camera;
  camera.width_px = width_px;
  camera.height_px = height_px;
  camera.fx_px = camera.fy_px = 0.5 * width_px / std::tan(0.5 * hfov_deg * 0.017453292519943295769);
  camera.cx_px = 0.5 * (width_px - 1);
  camera.cy_px = 0.5 * (height_px - 1);
  return camera;
}

Camera Camera::WithoutDistortion() const {
  Camera camera = *this;
  camera.distortion_model = DistortionModel::kPlumbBob;
  camera.distortion.fill(0);
  return camera;
}

bool Camera::HasDistortion() const {
  for (const double coefficient : distortion) {
    if (coefficient != 0) return true;
  }
  return false;
}

Eigen::Matrix3d Camera::Matrix() const {
  Eigen::Matrix3d K;
  K << fx_px, 0, cx_px, 0, fy_px, cy_px, 0, 0, 1;
  return K;
}

std::optional<Eigen::Vector2d> Camera::Project(const Eigen::Vector3d& x_in_cam) const {
  if (!(x_in_cam.z() > 0)) return std::nullopt;
  Eigen::Vector2d n = x_in_cam.head<2>() / x_in_cam.z();
  if (HasDistortion()) n = Distort(*this, n, nullptr);
  return Eigen::Vector2d(fx_px * n.x() + cx_px, fy_px * n.y() + cy_px);
}

Eigen::Vector2d Camera::Normalize(const Eigen::Vector2d& px) const {
  const Eigen::Vector2d target((px.x() - cx_px) / fx_px, (px.y() - cy_px) / fy_px);
  if (!HasDistortion()) return target;
  Eigen::Vector2d n = target;
  for (int iteration = 0; iteration < 20; ++iteration) {
    Eigen::Matrix2d jacobian;
    const Eigen::Vector2d residual = Distort(*this, n, &jacobian) - target;
    if (residual.squaredNorm() < 1e-28 || std::abs(jacobian.determinant()) < 1e-9) break;
    n -= jacobian.inverse() * residual;
  }
  return n;
}

Status Camera::Check() const {
  constexpr int kMaxSide_px = 32768;
  if (width_px < 16 || height_px < 16 || width_px > kMaxSide_px || height_px > kMaxSide_px) {
    return {ErrorCode::kInvalidArgument, Format("image size %dx%d; each side must lie in 16..%d",
                                                width_px, height_px, kMaxSide_px)};
  }
  for (const double value : {fx_px, fy_px, cx_px, cy_px}) {
    if (!std::isfinite(value)) return {ErrorCode::kInvalidArgument, "camera_matrix is not finite"};
  }
  if (fx_px <= 0 || fy_px <= 0) {
    return {ErrorCode::kInvalidArgument,
            Format("focal lengths %g, %g; must be above 0", fx_px, fy_px)};
  }
  for (const double value : distortion) {
    if (!std::isfinite(value)) {
      return {ErrorCode::kInvalidArgument, "distortion_coefficients are not finite"};
    }
  }
  return {};
}

const char* DistortionModelName(DistortionModel model) {
  return model == DistortionModel::kPlumbBob ? "plumb_bob" : "rational_polynomial";
}

}  // namespace panofix
