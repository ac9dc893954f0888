#pragma once
// Rectilinear views of a panorama: virtual pinhole cameras at its centre (paper, Eqs. 1-4).

#include <Eigen/Core>
#include <filesystem>
#include <memory>
#include <vector>

#include "builder/ingest/depth_map.h"
#include "common/base/status.h"
#include "common/camera/camera.h"
#include "common/image/gray_image.h"

namespace panofix {

// Direction of a virtual camera in the pano frame: yaw clockwise from the centre column, pitch up.
struct ViewDirection {
  double yaw_deg = 0, pitch_deg = 0;
};

// `count` directions, yaw step 360 / count, from `first_yaw_deg`, at one pitch; count >= 1.
[[nodiscard]] std::vector<ViewDirection> RingOfViews(int count, double pitch_deg,
                                                     double first_yaw_deg = 0);
// Rotation from a view's cam frame to the pano frame.
[[nodiscard]] Eigen::Matrix3d PanoFromCam(const ViewDirection& direction);

// JPEG reduction (1, 2, 4, 8) that keeps a panorama of `width_px` at least as fine as the views'
// centre (2 pi f pixels around), so that nothing is decoded that the views cannot show.
[[nodiscard]] int PanoramaReduction(int width_px, const Camera& view_camera);

// Decodes a panorama for `view_camera`: reduced decode, then a Gaussian prefilter of the remaining
// ratio where it exceeds 1, so that bilinear sampling does not alias.
[[nodiscard]] Result<GrayImage> DecodePanorama(const std::filesystem::path& path,
                                               const Camera& view_camera);

// Cuts views from panoramas. Immutable and thread-safe: one table of directions a pitch serves
// every yaw, panorama and size. A view index outside the directions throws std::out_of_range, an
// empty image std::invalid_argument.
class Rectifier {
 public:
  // `view_camera` must have no distortion, pitches must lie in -90..90 (std::invalid_argument).
  Rectifier(const Camera& view_camera, std::vector<ViewDirection> directions);
  ~Rectifier();
  [[nodiscard]] const Camera& camera() const;
  [[nodiscard]] const std::vector<ViewDirection>& directions() const;
  // View `view_idx` of an equirectangular image, bilinear, wrapping in azimuth.
  [[nodiscard]] GrayImage Cut(const GrayImage& panorama, int view_idx) const;
  // The view's perspective depth map: z-depth in metres along the optical axis (row-major, the
  // view's size), 0 = no surface; from the planes themselves.
  [[nodiscard]] std::vector<float> CutDepth(const DepthMap& depth, int view_idx) const;
  // Nearest-neighbour cut, for masks (any size, 2:1 not required).
  [[nodiscard]] GrayImage CutMask(const GrayImage& mask, int view_idx) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace panofix
