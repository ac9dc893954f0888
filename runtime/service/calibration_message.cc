// panofix.camera.v1: the camera's calibration.

#include <cmath>

#include "runtime/service/messages.h"
#include "runtime/service/wire_internal.h"
#include "schemas/CameraCalibration_generated.h"

namespace panofix {
namespace {

using wire_internal::Bad;

std::size_t NumParameters(DistortionModel model) {
  return model == DistortionModel::kPlumbBob ? 5 : 8;
}

Status ReadMatrix(const flatbuffers::Vector<double>* k, Camera& camera) {
  if (k == nullptr || k->size() != 9) return Bad("CameraCalibration.k: must hold 9 numbers");
  for (const flatbuffers::uoffset_t zero_idx : {1U, 3U, 6U, 7U}) {
    if (k->Get(zero_idx) != 0) return Bad("CameraCalibration.k: skewed pixels are not supported");
  }
  if (k->Get(8) != 1) return Bad("CameraCalibration.k: the last number must be 1");
  camera.fx_px = k->Get(0), camera.cx_px = k->Get(2);
  camera.fy_px = k->Get(4), camera.cy_px = k->Get(5);
  if (camera.fx_px == 0) return Bad("CameraCalibration.k: the camera is not calibrated (fx = 0)");
  return {};
}

Status ReadDistortion(const foxglove::CameraCalibration& message, Camera& camera) {
  auto model =
      wire_internal::Text(message.distortion_model(), "CameraCalibration.distortion_model");
  if (!model.ok()) return model.status();
  if (model->empty() || *model == "plumb_bob") {
    camera.distortion_model = DistortionModel::kPlumbBob;
  } else if (*model == "rational_polynomial") {
    camera.distortion_model = DistortionModel::kRationalPolynomial;
  } else {
    return Bad("CameraCalibration.distortion_model '" + *model +
               "'; calibrate as plumb_bob or rational_polynomial");
  }
  const flatbuffers::uoffset_t size = message.d() == nullptr ? 0 : message.d()->size();
  const std::size_t expected = NumParameters(camera.distortion_model);
  // plumb_bob is also written with k3 left out.
  const bool short_plumb_bob = camera.distortion_model == DistortionModel::kPlumbBob && size == 4;
  if (size != 0 && size != expected && !short_plumb_bob) {
    return Bad(Format("CameraCalibration.d: %u numbers; the model has %zu", size, expected));
  }
  for (flatbuffers::uoffset_t i = 0; i < size; ++i) camera.distortion[i] = message.d()->Get(i);
  return {};
}

}  // namespace

std::vector<std::uint8_t> PackCalibration(std::int64_t timestamp_ns, const Camera& camera) {
  const foxglove::Time time = wire_internal::ToWireTime(timestamp_ns);
  flatbuffers::FlatBufferBuilder builder;
  const auto frame_id = builder.CreateString("cam");
  const auto model = builder.CreateString(DistortionModelName(camera.distortion_model));
  const auto d =
      builder.CreateVector(camera.distortion.data(), NumParameters(camera.distortion_model));
  const double k[9] = {camera.fx_px, 0, camera.cx_px, 0, camera.fy_px, camera.cy_px, 0, 0, 1};
  const double r[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  const double p[12] = {k[0], 0, k[2], 0, 0, k[4], k[5], 0, 0, 0, 1, 0};
  const auto k_vector = builder.CreateVector(k, 9);
  const auto r_vector = builder.CreateVector(r, 9);
  const auto p_vector = builder.CreateVector(p, 12);
  foxglove::FinishCameraCalibrationBuffer(
      builder, foxglove::CreateCameraCalibration(builder, &time, frame_id,
                                                 static_cast<std::uint32_t>(camera.width_px),
                                                 static_cast<std::uint32_t>(camera.height_px),
                                                 model, d, k_vector, r_vector, p_vector));
  return wire_internal::TakeBytes(builder);
}

Result<Camera> UnpackCalibration(const WireBytes& payload) {
  const WireBytes aligned = payload.Aligned();
  const auto* message = wire_internal::VerifiedRoot<foxglove::CameraCalibration>(
      aligned.bytes, foxglove::CameraCalibrationIdentifier());
  if (message == nullptr) {
    return Bad(Format("camera payload of %zu bytes is no CameraCalibration with file identifier %s",
                      aligned.bytes.size(), foxglove::CameraCalibrationIdentifier()));
  }
  Camera camera;
  if (message->width() > INT32_MAX || message->height() > INT32_MAX) {
    return Bad(Format("CameraCalibration: %ux%u pixels", message->width(), message->height()));
  }
  camera.width_px = static_cast<int>(message->width());
  camera.height_px = static_cast<int>(message->height());
  if (Status status = ReadMatrix(message->k(), camera); !status.ok()) return status;
  if (Status status = ReadDistortion(*message, camera); !status.ok()) return status;
  if (Status status = camera.Check(); !status.ok()) {
    return Bad("CameraCalibration: " + status.message());
  }
  return camera;
}

}  // namespace panofix
