#pragma once
// The vehicle camera: pinhole with OpenCV's plumb_bob or rational_polynomial distortion.

#include <Eigen/Core>
#include <array>
#include <filesystem>
#include <optional>
#include <string>

#include "common/base/status.h"

namespace panofix {

enum class DistortionModel { kPlumbBob, kRationalPolynomial };

// Integer pixel coordinates are pixel centres. cam: x right, y down, z forward.
struct Camera {
  int width_px = 0, height_px = 0;
  double fx_px = 0, fy_px = 0, cx_px = 0, cy_px = 0;
  DistortionModel distortion_model = DistortionModel::kPlumbBob;
  // k1 k2 p1 p2 k3 (k4 k5 k6), OpenCV's order; unused ones are 0.
  std::array<double, 8> distortion{};

  // Square pixels, centred principal point, no distortion.
  [[nodiscard]] static Camera FromHorizontalFov(int width_px, int height_px, double hfov_deg);
  // The same K and size without the distortion: what a rectilinear view is cut with.
  [[nodiscard]] Camera WithoutDistortion() const;
  [[nodiscard]] bool HasDistortion() const;
  // K, 3x3.
  [[nodiscard]] Eigen::Matrix3d Matrix() const;
  // Pixel of a point in cam; nullopt where it lies behind the camera.
  [[nodiscard]] std::optional<Eigen::Vector2d> Project(const Eigen::Vector3d& x_in_cam) const;
  // Undistorted normalised coordinates (x/z, y/z) of a pixel (Newton; exact to 1e-12 where the
  // model is invertible).
  [[nodiscard]] Eigen::Vector2d Normalize(const Eigen::Vector2d& px) const;
  // kInvalidArgument with the offending field named: sizes, focal lengths, finiteness.
  [[nodiscard]] Status Check() const;
};

// Reads the ROS camera_info layout (image_width, image_height, camera_matrix, distortion_model,
// distortion_coefficients). Every failure names the file, the key and the mend.
[[nodiscard]] Result<Camera> ReadCameraYaml(const std::filesystem::path& path);
[[nodiscard]] Result<Camera> ParseCameraYaml(const std::string& text, const std::string& name);
// The layout that ReadCameraYaml reads; doubles round trip.
[[nodiscard]] std::string ToCameraYaml(const Camera& camera, const std::string& camera_name);
[[nodiscard]] const char* DistortionModelName(DistortionModel model);

}  // namespace panofix
