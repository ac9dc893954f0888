#include "common/image/gray_image.h"

#include <mutex>
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "common/base/log.h"
#include "common/image/image_header.h"
#include "common/image/jpeg_decoder.h"

namespace panofix {
namespace {

using Bytes = std::span<const std::uint8_t>;

// OpenCV repeats on stderr what we report ourselves.
void SilenceOpenCv() {
  static std::once_flag once;
  std::call_once(once,
                 [] { cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT); });
}

// Everything that can be refused before memory is taken.
Result<ImageHeader> CheckBeforeDecoding(Bytes bytes, const DecodeLimits& limits) {
  const std::size_t max_bytes = std::min<std::size_t>(limits.max_bytes, INT32_MAX);
  if (bytes.size() > max_bytes) {
    return Status(ErrorCode::kTooLarge,
                  Format("%zu bytes; an image may have %zu", bytes.size(), max_bytes));
  }
  Result<ImageHeader> header = ParseImageHeader(bytes);
  if (!header.ok()) return header;
  const ImageSize size = header->size;
  if (static_cast<std::int64_t>(size.width_px) * size.height_px > limits.max_pixels) {
    return Status(ErrorCode::kTooLarge,
                  Format("%dx%d pixels; an image may have %lld", size.width_px, size.height_px,
                         static_cast<long long>(limits.max_pixels)));
  }
  if (Status complete = CheckImageComplete(bytes, *header); !complete.ok()) return complete;
  return header;
}

// cv::imdecode without its exceptions; empty where the decoder gives up.
cv::Mat DecodePng(Bytes bytes, int flags) {
  SilenceOpenCv();
  // imdecode reads through a Mat header and does not write.
  const cv::Mat wrapped(1, static_cast<int>(bytes.size()), CV_8UC1,
                        const_cast<std::uint8_t*>(bytes.data()));
  try {
    return cv::imdecode(wrapped, flags | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const std::exception&) {
    return {};
  }
}

Status DecoderGaveUp() {
  return {ErrorCode::kBadData,
          "the decoder gave up on damaged data; copy or export the image again"};
}

// Means over whole blocks; OpenCV's own reduction of a PNG samples two pixels a block.
cv::Mat ReduceByArea(const cv::Mat& full, int reduction) {
  const cv::Size reduced((full.cols + reduction - 1) / reduction,
                         (full.rows + reduction - 1) / reduction);
  const int pad_right = reduced.width * reduction - full.cols;
  const int pad_bottom = reduced.height * reduction - full.rows;
  cv::Mat padded = full, result;
  if (pad_right > 0 || pad_bottom > 0) {
    cv::copyMakeBorder(full, padded, 0, pad_bottom, 0, pad_right, cv::BORDER_REPLICATE);
  }
  cv::resize(padded, result, reduced, 0, 0, cv::INTER_AREA);
  return result;
}

template <typename Pixel>
std::vector<Pixel> CopyPixels(const cv::Mat& mat) {
  std::vector<Pixel> pixels;
  pixels.reserve(mat.total());
  for (int row = 0; row < mat.rows; ++row) {
    const Pixel* begin = mat.ptr<Pixel>(row);
    pixels.insert(pixels.end(), begin, begin + mat.cols);
  }
  return pixels;
}

}  // namespace

Result<ImageSize> ReadImageSize(Bytes bytes) {
  const Result<ImageHeader> header = ParseImageHeader(bytes);
  if (!header.ok()) return header.status();
  return header->size;
}

Result<GrayImage> DecodeGray(Bytes bytes, int reduction, const DecodeLimits& limits) {
  if (reduction != 1 && reduction != 2 && reduction != 4 && reduction != 8) {
    return Status(ErrorCode::kInvalidArgument, Format("reduction %d; use 1, 2, 4 or 8", reduction));
  }
  const Result<ImageHeader> header = CheckBeforeDecoding(bytes, limits);
  if (!header.ok()) return header.status();
  if (header->kind == ImageKind::kJpeg) return DecodeJpegGray(bytes, header->size, reduction);
  cv::Mat mat = DecodePng(bytes, cv::IMREAD_GRAYSCALE);
  if (mat.type() != CV_8UC1 || mat.cols != header->size.width_px ||
      mat.rows != header->size.height_px) {
    return DecoderGaveUp();
  }
  if (reduction > 1) mat = ReduceByArea(mat, reduction);
  return GrayImage{mat.cols, mat.rows, CopyPixels<std::uint8_t>(mat)};
}

Result<Gray16Image> DecodePng16(Bytes bytes, const DecodeLimits& limits) {
  const Result<ImageHeader> header = CheckBeforeDecoding(bytes, limits);
  if (!header.ok()) return header.status();
  if (header->kind != ImageKind::kPng || header->bits_per_channel != 16 ||
      header->num_channels != 1) {
    return Status(ErrorCode::kBadData,
                  Format("%s of %d channels of %d bits; write a PNG of one 16-bit channel",
                         header->kind == ImageKind::kPng ? "a PNG" : "a JPEG", header->num_channels,
                         header->bits_per_channel));
  }
  const cv::Mat mat = DecodePng(bytes, cv::IMREAD_UNCHANGED);
  if (mat.type() != CV_16UC1 || mat.cols != header->size.width_px ||
      mat.rows != header->size.height_px) {
    return DecoderGaveUp();
  }
  return Gray16Image{mat.cols, mat.rows, CopyPixels<std::uint16_t>(mat)};
}

}  // namespace panofix
