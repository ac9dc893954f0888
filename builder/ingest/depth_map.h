#pragma once
// A panorama's depth: Street View's plane-coded payload (.gsv) or a 16-bit range raster (.png).

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "common/base/status.h"

namespace panofix {

// n . X = d in the pano frame (metres). Plane 0 of a payload means "no surface".
struct DepthPlane {
  Eigen::Vector3f normal_in_pano = Eigen::Vector3f::Zero();
  float d_m = 0;
};

// Where a ray meets the depth.
struct DepthHit {
  double range_m = 0;                                        // along the unit ray
  Eigen::Vector3d normal_in_pano = Eigen::Vector3d::Zero();  // unit; towards the panorama
  int surface_idx = 0;                                       // plane index; 0 for a raster
};

// Immutable, thread-safe. Column 0 is heading - 180 degrees, row 0 the zenith; a pixel covers
// azimuth ((c + 0.5) / W - 0.5) 360 deg, elevation (0.5 - (r + 0.5) / H) 180 deg.
class DepthMap {
 public:
  // Decodes .gsv text: base64 (URL-safe or not, padded or not) of a raw or zlib payload. kBadData
  // or kTooLarge with the fault; never reads outside `text` or inflates past the largest legal
  // payload. White space may follow the text; fewer than 16 zero bytes may follow the planes.
  [[nodiscard]] static Result<DepthMap> DecodeGsv(std::string_view text);
  // Range raster: metres = value * scale; 0 = no surface.
  [[nodiscard]] static Result<DepthMap> DecodePng(std::span<const std::uint8_t> bytes,
                                                  double scale_m);
  // By extension; messages name the file.
  [[nodiscard]] static Result<DepthMap> Read(const std::filesystem::path& path, double scale_m);

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  [[nodiscard]] const std::vector<DepthPlane>& planes() const { return planes_; }
  [[nodiscard]] bool is_zlib() const { return is_zlib_; }
  // At most 2 planes: not a measurement (INTERFACES); such a panorama has no depth.
  [[nodiscard]] bool is_placeholder() const { return !planes_.empty() && planes_.size() <= 2; }
  // Plane index of a pixel (0 for a raster). Throws std::out_of_range outside the map.
  [[nodiscard]] int PlaneIndex(int column, int row) const;
  // Share of pixels with a surface, [0, 1].
  [[nodiscard]] double SurfaceShare() const;
  // Index of the near-horizontal plane (|n_z| > 0.9 |n|) that covers most pixels of rows
  // H*3/4..H-1.
  [[nodiscard]] std::optional<int> GroundPlane() const;

  // Range along a unit ray of the pano frame, from the plane itself (|d / (v . n)|), or bilinear in
  // inverse range within one surface for a raster. nullopt where there is no surface or the range
  // is not finite and above 0.
  [[nodiscard]] std::optional<DepthHit> Cast(const Eigen::Vector3d& ray_in_pano) const;
  // The same for a caller that knows the ray's fractional pixel already; saves its arctangents.
  [[nodiscard]] std::optional<DepthHit> CastAt(double column, double row,
                                               const Eigen::Vector3d& ray_in_pano) const;
  // The same through the centre of a depth pixel. Throws std::out_of_range outside the map.
  [[nodiscard]] std::optional<DepthHit> CastPixel(int column, int row) const;
  // Unit ray through a pixel's centre (fractional pixels allowed).
  [[nodiscard]] Eigen::Vector3d PixelRay(double column, double row) const;

 private:
  DepthMap(int width, int height) : width_(width), height_(height) {}
  [[nodiscard]] std::size_t PixelIndex(int column, int row) const;
  [[nodiscard]] std::optional<DepthHit> CastPlane(int plane_idx,
                                                  const Eigen::Vector3d& ray_in_pano) const;
  [[nodiscard]] std::optional<DepthHit> CastRaster(double column, double row,
                                                   const Eigen::Vector3d& ray_in_pano) const;
  [[nodiscard]] Eigen::Vector3d RasterNormal(int column, int row,
                                             const Eigen::Vector3d& ray_in_pano) const;

  int width_ = 0, height_ = 0;
  bool is_zlib_ = false;
  std::vector<DepthPlane> planes_;       // empty for a raster
  std::vector<std::uint8_t> plane_idx_;  // width * height, plane-coded
  std::vector<float> range_m_;           // width * height, raster; 0 = no surface
};

}  // namespace panofix
