// The half of rectifier.h that decodes panoramas to the resolution the views can show.

#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "builder/rectify/rectifier.h"
#include "common/base/log.h"

namespace panofix {
namespace {

// Columns around a panorama whose pixels match the views' at their centre.
double MatchingWidth_px(const Camera& view_camera) {
  return 2 * std::numbers::pi * std::max(view_camera.fx_px, view_camera.fy_px);
}

// An image is taken to be blurred by half a pixel (Lowe, "Distinctive image features", 2004,
// section 3.3); shrinking it by `ratio` without aliasing wants half a pixel of the result.
double PrefilterSigma_px(double ratio) {
  constexpr double kNominalBlur_px = 0.5;
  return ratio > 1 ? kNominalBlur_px * std::sqrt(ratio * ratio - 1) : 0;
}

// Blurs in place, joining left and right.
void Blur(GrayImage& image, double sigma_px) {
  const int radius = std::min(static_cast<int>(std::ceil(4 * sigma_px)), image.width_px);
  cv::Mat mat(image.height_px, image.width_px, CV_8UC1, image.pixels.data());
  cv::Mat padded;
  cv::copyMakeBorder(mat, padded, 0, 0, radius, radius, cv::BORDER_WRAP);
  cv::GaussianBlur(padded, padded, cv::Size(2 * radius + 1, 2 * radius + 1), sigma_px, sigma_px,
                   cv::BORDER_REPLICATE);
  padded.colRange(radius, radius + image.width_px).copyTo(mat);
}

}  // namespace

int PanoramaReduction(int width_px, const Camera& view_camera) {
  for (const int reduction : {8, 4, 2}) {
    if (static_cast<double>(width_px) / reduction >= MatchingWidth_px(view_camera))
      return reduction;
  }
  return 1;
}

Result<GrayImage> DecodePanorama(const std::filesystem::path& path, const Camera& view_camera) {
  const auto named = [&](const Status& status) {
    return Status(status.code(), path.string() + ": " + status.message());
  };
  const auto bytes = ReadFileBytes(path, DecodeLimits().max_bytes);
  if (!bytes.ok()) return bytes.status();
  const Result<ImageSize> size = ReadImageSize(*bytes);
  if (!size.ok()) return named(size.status());
  if (size->width_px != 2 * size->height_px) {
    return named(
        {ErrorCode::kBadData, Format("%dx%d is not equirectangular; the width must be twice "
                                     "the height",
                                     size->width_px, size->height_px)});
  }
  int reduction = PanoramaReduction(size->width_px, view_camera);
  // A block cut short at the right edge would shift every column's azimuth.
  while (size->height_px % reduction != 0) reduction /= 2;
  Result<GrayImage> image = DecodeGray(*bytes, reduction);
  if (!image.ok()) return named(image.status());
  const double sigma_px = PrefilterSigma_px(image->width_px / MatchingWidth_px(view_camera));
  constexpr double kMinSigma_px = 0.2;  // a narrower kernel rounds to the identity in 8 bits
  if (sigma_px >= kMinSigma_px) Blur(*image, sigma_px);
  return image;
}

}  // namespace panofix
