// panofix.frame.v1: camera frames, compressed or raw.

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "runtime/service/messages.h"
#include "runtime/service/wire_internal.h"
#include "schemas/CompressedImage_generated.h"
#include "schemas/RawImage_generated.h"

namespace panofix {
namespace {

using wire_internal::Bad;

Result<IncomingFrame> UnpackCompressed(IncomingFrame frame) {
  const auto* image = wire_internal::VerifiedRoot<foxglove::CompressedImage>(
      frame.payload.bytes, foxglove::CompressedImageIdentifier());
  if (image == nullptr) return Bad("CompressedImage does not verify; send it whole");
  auto time = wire_internal::FromWireTime(image->timestamp(), "CompressedImage");
  if (!time.ok()) return time.status();
  auto format = wire_internal::Text(image->format(), "CompressedImage.format");
  if (!format.ok()) return format.status();
  frame.timestamp_ns = *time;
  frame.kind = FrameKind::kCompressed;
  frame.encoding = *format;
  if (image->data() != nullptr) frame.data = {image->data()->data(), image->data()->size()};
  return frame;
}

Result<IncomingFrame> UnpackRaw(IncomingFrame frame) {
  const auto* image = wire_internal::VerifiedRoot<foxglove::RawImage>(
      frame.payload.bytes, foxglove::RawImageIdentifier());
  if (image == nullptr) return Bad("RawImage does not verify; send it whole");
  auto time = wire_internal::FromWireTime(image->timestamp(), "RawImage");
  if (!time.ok()) return time.status();
  auto encoding = wire_internal::Text(image->encoding(), "RawImage.encoding");
  if (!encoding.ok()) return encoding.status();
  frame.timestamp_ns = *time;
  frame.kind = FrameKind::kRaw;
  frame.encoding = *encoding;
  frame.width_px = image->width();
  frame.height_px = image->height();
  frame.step_bytes = image->step();
  if (image->data() != nullptr) frame.data = {image->data()->data(), image->data()->size()};
  return frame;
}

int BytesPerPixel(const std::string& encoding) {
  if (encoding == "mono8" || encoding == "8UC1") return 1;
  if (encoding == "bgr8" || encoding == "8UC3" || encoding == "rgb8") return 3;
  return 0;
}

Status CheckRaw(const IncomingFrame& frame, const DecodeLimits& limits) {
  const auto pixel_bytes = static_cast<std::uint64_t>(BytesPerPixel(frame.encoding));
  if (pixel_bytes == 0) {
    return Bad("raw frame encoded as '" + frame.encoding + "'; send mono8, bgr8 or rgb8");
  }
  // Products of two 32-bit numbers fit 64 bits.
  const std::uint64_t width = frame.width_px, height = frame.height_px, step = frame.step_bytes;
  if (width == 0 || height == 0) {
    return Bad(
        Format("raw frame of %ux%u pixels; both must be above 0", frame.width_px, frame.height_px));
  }
  if (width * height > static_cast<std::uint64_t>(limits.max_pixels)) {
    return {ErrorCode::kTooLarge,
            Format("raw frame of %ux%u pixels; at most %lld pixels", frame.width_px,
                   frame.height_px, static_cast<long long>(limits.max_pixels))};
  }
  if (step < width * pixel_bytes) {
    return Bad(Format("raw frame's step %u; %u pixels of %s need %llu", frame.step_bytes,
                      frame.width_px, frame.encoding.c_str(),
                      static_cast<unsigned long long>(width * pixel_bytes)));
  }
  // The last row may lack its padding.
  const std::uint64_t last_row = width * pixel_bytes;
  if (height - 1 > (UINT64_MAX - last_row) / step ||
      frame.data.size() < step * (height - 1) + last_row) {
    return Bad(Format("raw frame of %ux%u pixels, step %u, has %zu bytes: cut short",
                      frame.width_px, frame.height_px, frame.step_bytes, frame.data.size()));
  }
  return {};
}

Result<GrayImage> ConvertRaw(const IncomingFrame& frame, const DecodeLimits& limits) {
  if (Status status = CheckRaw(frame, limits); !status.ok()) return status;
  GrayImage gray;
  gray.width_px = static_cast<int>(frame.width_px);
  gray.height_px = static_cast<int>(frame.height_px);
  gray.pixels.resize(std::size_t{frame.width_px} * frame.height_px);
  const int type = BytesPerPixel(frame.encoding) == 1 ? CV_8UC1 : CV_8UC3;
  try {
    // OpenCV takes no const pointer; the source is only read.
    const cv::Mat source(gray.height_px, gray.width_px, type,
                         const_cast<std::uint8_t*>(frame.data.data()), frame.step_bytes);
    cv::Mat target(gray.height_px, gray.width_px, CV_8UC1, gray.pixels.data());
    if (type == CV_8UC1) {
      source.copyTo(target);
    } else {
      cv::cvtColor(source, target,
                   frame.encoding == "rgb8" ? cv::COLOR_RGB2GRAY : cv::COLOR_BGR2GRAY);
    }
  } catch (const cv::Exception& error) {
    return Status(ErrorCode::kInternal, std::string("raw frame: ") + error.what());
  }
  return gray;
}

}  // namespace

bool FitsWireTime(std::int64_t timestamp_ns) {
  return timestamp_ns >= 0 && timestamp_ns / wire_internal::kNsPerS <= UINT32_MAX;
}

std::vector<std::uint8_t> PackFrame(std::int64_t timestamp_ns,
                                    std::span<const std::uint8_t> file_bytes,
                                    const std::string& format) {
  const foxglove::Time time = wire_internal::ToWireTime(timestamp_ns);
  flatbuffers::FlatBufferBuilder builder(file_bytes.size() + 256);
  const auto frame_id = builder.CreateString("cam");
  const auto data = builder.CreateVector(file_bytes.data(), file_bytes.size());
  const auto format_text = builder.CreateString(format);
  foxglove::FinishCompressedImageBuffer(
      builder, foxglove::CreateCompressedImage(builder, &time, frame_id, data, format_text));
  return wire_internal::TakeBytes(builder);
}

std::vector<std::uint8_t> PackRawFrame(std::int64_t timestamp_ns, const GrayImage& image) {
  const foxglove::Time time = wire_internal::ToWireTime(timestamp_ns);
  flatbuffers::FlatBufferBuilder builder(image.pixels.size() + 256);
  const auto frame_id = builder.CreateString("cam");
  const auto encoding = builder.CreateString("mono8");
  const auto data = builder.CreateVector(image.pixels.data(), image.pixels.size());
  const auto width = static_cast<std::uint32_t>(image.width_px);
  foxglove::FinishRawImageBuffer(
      builder,
      foxglove::CreateRawImage(builder, &time, frame_id, width,
                               static_cast<std::uint32_t>(image.height_px), encoding, width, data));
  return wire_internal::TakeBytes(builder);
}

Result<IncomingFrame> UnpackFrame(const WireBytes& payload) {
  IncomingFrame frame;
  frame.payload = payload.Aligned();
  const auto bytes = frame.payload.bytes;
  if (wire_internal::HasIdentifier(bytes, foxglove::CompressedImageIdentifier())) {
    return UnpackCompressed(std::move(frame));
  }
  if (wire_internal::HasIdentifier(bytes, foxglove::RawImageIdentifier())) {
    return UnpackRaw(std::move(frame));
  }
  return Bad(
      Format("frame payload of %zu bytes has neither file identifier %s (CompressedImage) nor "
             "%s (RawImage); finish the buffer with one",
             bytes.size(), foxglove::CompressedImageIdentifier(), foxglove::RawImageIdentifier()));
}

Result<GrayImage> ConvertFrame(const IncomingFrame& frame, const DecodeLimits& limits) try {
  if (frame.kind == FrameKind::kRaw) return ConvertRaw(frame, limits);
  if (frame.encoding != "jpeg" && frame.encoding != "png") {
    return Bad("compressed frame of format '" + frame.encoding + "'; send jpeg or png");
  }
  if (frame.data.empty()) return Bad("compressed frame without bytes");
  return DecodeGray(frame.data, 1, limits);
} catch (const std::bad_alloc&) {
  return Status(ErrorCode::kTooLarge, "no memory for the frame's pixels");
}

DecodeLimits FrameLimitsFor(const Camera& camera) {
  constexpr std::int64_t kFactor = 4, kLeast = 1'000'000;
  DecodeLimits limits;
  limits.max_pixels = kLeast + kFactor * camera.width_px * camera.height_px;
  return limits;
}

}  // namespace panofix
