// panofix.location_fix.v1: the position for tools that know nothing of panofix.

#include "runtime/service/messages.h"
#include "runtime/service/wire_internal.h"
#include "schemas/LocationFix_generated.h"

namespace panofix {

std::vector<std::uint8_t> PackLocationFix(const FrameResult& result, const BundleIdentity& bundle) {
  if (!result.pose) throw std::logic_error("PackLocationFix: the result has no pose");
  const FramePose& pose = *result.pose;
  const foxglove::Time time = wire_internal::ToWireTime(result.timestamp_ns);
  flatbuffers::FlatBufferBuilder builder(1024);

  const Eigen::Matrix3d enu_from_map =
      (pose.enu_from_cam * pose.map_from_cam.conjugate()).normalized().toRotationMatrix();
  const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> covariance_in_enu =
      enu_from_map * pose.covariance_in_map.topLeftCorner<3, 3>() * enu_from_map.transpose();
  const auto covariance = builder.CreateVector(covariance_in_enu.data(), 9);

  const auto pair = [&builder](const char* key, const std::string& value) {
    const auto key_text = builder.CreateString(key);
    const auto value_text = builder.CreateString(value);
    return foxglove::CreateKeyValuePair(builder, key_text, value_text);
  };
  const std::vector<flatbuffers::Offset<foxglove::KeyValuePair>> pairs{
      pair("status", FixStatusName(result.status)), pair("reason", result.reason),
      pair("num_inliers", std::to_string(result.num_inliers)), pair("bundle_id", bundle.id),
      pair("map_is_unsigned", bundle.is_signed ? "false" : "true")};
  const auto metadata = builder.CreateVector(pairs);
  const auto frame_id = builder.CreateString("cam");

  foxglove::LocationFixBuilder fix(builder);
  fix.add_timestamp(&time);
  fix.add_frame_id(frame_id);
  fix.add_latitude(pose.position.lat_deg);
  fix.add_longitude(pose.position.lon_deg);
  fix.add_altitude(pose.position.height_m);
  fix.add_position_covariance(covariance);
  fix.add_position_covariance_type(foxglove::PositionCovarianceType::KNOWN);
  fix.add_metadata(metadata);
  fix.add_heading(pose.attitude.heading_deg * kRadPerDeg);
  foxglove::FinishLocationFixBuffer(builder, fix.Finish());
  return wire_internal::TakeBytes(builder);
}

}  // namespace panofix
