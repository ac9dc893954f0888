#pragma once
// Product types to FlatBuffers payloads and back. Pack functions write what schemas/ says, with
// file identifiers; Unpack functions verify every byte before use and return kBadData or kTooLarge
// with a line that names the fault. Thread-safe; no exception leaves an Unpack function.
//
// Times on the wire are unsigned 32-bit seconds since 1970 and nanoseconds: FitsWireTime says
// whether a timestamp can be written. A Pack function given one that cannot throws
// std::logic_error.

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/camera/camera.h"
#include "common/drive/poses_csv.h"
#include "common/image/gray_image.h"
#include "runtime/localizer/localizer.h"
#include "runtime/service/wire_bytes.h"

namespace panofix {

[[nodiscard]] bool FitsWireTime(std::int64_t timestamp_ns);

// ---- panofix.frame.v1

enum class FrameKind { kCompressed, kRaw };

// A frame whose structure and time are verified; its pixels are not yet looked at. Holds the
// payload.
struct IncomingFrame {
  std::int64_t timestamp_ns = 0;
  FrameKind kind = FrameKind::kCompressed;
  std::string encoding;                       // "jpeg", "png"; raw: "mono8", "bgr8", "rgb8"
  std::uint32_t width_px = 0, height_px = 0;  // raw only
  std::uint32_t step_bytes = 0;               // raw only: from row to row
  WireBytes payload;
  std::span<const std::uint8_t> data;  // within payload
};

// CompressedImage of a JPEG's or PNG's bytes as they are; `format` is "jpeg" or "png".
[[nodiscard]] std::vector<std::uint8_t> PackFrame(std::int64_t timestamp_ns,
                                                  std::span<const std::uint8_t> file_bytes,
                                                  const std::string& format = "jpeg");
// RawImage of grey pixels (mono8).
[[nodiscard]] std::vector<std::uint8_t> PackRawFrame(std::int64_t timestamp_ns,
                                                     const GrayImage& image);
[[nodiscard]] Result<IncomingFrame> UnpackFrame(const WireBytes& payload);
// Grey pixels of a frame. Colour becomes grey by the BT.601 weights in OpenCV's integer arithmetic
// (cvtColor), so that raw and decoded frames agree. kBadData: unknown encoding, rows that do not
// fit their step, too few bytes, an image that ends early. kTooLarge: more pixels than `limits`.
[[nodiscard]] Result<GrayImage> ConvertFrame(const IncomingFrame& frame,
                                             const DecodeLimits& limits = {});
// A frame of another size than the camera's is of no use; decoding one much larger is a waste that
// a stranger could ask for.
[[nodiscard]] DecodeLimits FrameLimitsFor(const Camera& camera);

// ---- panofix.camera.v1

[[nodiscard]] std::vector<std::uint8_t> PackCalibration(std::int64_t timestamp_ns,
                                                        const Camera& camera);
// kBadData also for an uncalibrated camera (fx = 0), skewed pixels and models other than plumb_bob
// and rational_polynomial.
[[nodiscard]] Result<Camera> UnpackCalibration(const WireBytes& payload);

// ---- panofix.pose.v1

// `decode_ms`: time from payload to grey pixels; added to the result's total latency.
[[nodiscard]] std::vector<std::uint8_t> PackResult(const FrameResult& result,
                                                   const BundleIdentity& bundle,
                                                   double decode_ms = 0);

struct ReceivedResult {
  PoseRow row;            // what poses.csv holds of it
  FrameResult result;     // the same with map pose, covariance and latency by stage
  BundleIdentity bundle;  // name, id, build, is_signed; the counts are not on the wire
  double decode_ms = 0;
};
[[nodiscard]] Result<ReceivedResult> UnpackResult(const WireBytes& payload);

// ---- panofix.location_fix.v1

// REQUIRES: result.pose.
[[nodiscard]] std::vector<std::uint8_t> PackLocationFix(const FrameResult& result,
                                                        const BundleIdentity& bundle);

}  // namespace panofix
