#include "runtime/service/frame_preview.h"

#include <algorithm>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "common/base/log.h"

namespace panofix {

std::vector<std::uint8_t> EncodePreview(const IncomingFrame& frame,
                                        const DecodeLimits& limits) try {
  constexpr int kLongestSide_px = 1280, kQuality = 85;
  auto gray = ConvertFrame(frame, limits);
  if (!gray.ok()) return {};
  cv::Mat image(gray->height_px, gray->width_px, CV_8UC1, gray->pixels.data());
  const int longest_px = std::max(image.cols, image.rows);
  if (longest_px > kLongestSide_px) {
    const double scale = static_cast<double>(kLongestSide_px) / longest_px;
    const cv::Size size(std::max(1, cvRound(scale * image.cols)),
                        std::max(1, cvRound(scale * image.rows)));
    cv::Mat small;
    cv::resize(image, small, size, 0, 0, cv::INTER_AREA);
    image = small;
  }
  std::vector<std::uint8_t> jpeg;
  cv::imencode(".jpg", image, jpeg, {cv::IMWRITE_JPEG_QUALITY, kQuality});
  return jpeg;
} catch (const std::exception& error) {
  LogWarning(std::string("no live picture of a raw frame: ") + error.what());
  return {};
}

}  // namespace panofix
