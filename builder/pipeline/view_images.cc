#include "builder/pipeline/view_images.h"

#include <tbb/parallel_for.h>

#include <opencv2/imgcodecs.hpp>

#include "common/features/features.h"

namespace panofix {
namespace {

constexpr int kJpegQuality =
    95;  // gradients, which lines are described by, stay within a grey level

std::vector<std::uint8_t> EncodeJpeg(GrayImage image) {
  const cv::Mat mat(image.height_px, image.width_px, CV_8UC1, image.pixels.data());
  std::vector<std::uint8_t> bytes;
  if (!cv::imencode(".jpg", mat, bytes, {cv::IMWRITE_JPEG_QUALITY, kJpegQuality}))
    throw Error(ErrorCode::kInternal, "a view could not be encoded as JPEG");
  return bytes;
}

}  // namespace

std::vector<std::vector<std::uint8_t>> EncodeViewImages(
    std::span<const ExtractedPanorama> panoramas, const Rectifier& rectifier,
    const FeatureOptions& features) {
  const std::size_t per_panorama = rectifier.directions().size();
  std::vector<std::vector<std::uint8_t>> images(panoramas.size() * per_panorama);
  tbb::parallel_for(std::size_t{0}, panoramas.size(), [&](std::size_t p) {
    const GrayImage panorama =
        ValueOrThrow(DecodePanorama(panoramas[p].record.image, rectifier.camera()));
    for (std::size_t v = 0; v < per_panorama; ++v) {
      images[p * per_panorama + v] =
          EncodeJpeg(Preprocess(rectifier.Cut(panorama, static_cast<int>(v)), features));
    }
  });
  return images;
}

}  // namespace panofix
