// panofix.pose.v1, packing: what the engine said of one frame.

#include "runtime/service/messages.h"
#include "runtime/service/wire_internal.h"
#include "schemas/LocalizationResult_generated.h"

namespace panofix {
namespace {

using Builder = flatbuffers::FlatBufferBuilder;
using RowMajor6 = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;

flatbuffers::Offset<foxglove::Quaternion> PackQuaternion(Builder& builder,
                                                         const Eigen::Quaterniond& q) {
  return foxglove::CreateQuaternion(builder, q.x(), q.y(), q.z(), q.w());
}

struct PoseOffsets {
  flatbuffers::Offset<wire::GeodeticPose> geodetic;
  flatbuffers::Offset<foxglove::Pose> map;
  flatbuffers::Offset<flatbuffers::Vector<double>> covariance;
  flatbuffers::Offset<wire::PoseSigma> sigma;
};

PoseOffsets PackPose(Builder& builder, const FramePose& pose) {
  PoseOffsets offsets;
  const Eigen::Vector3d& p = pose.position_in_map;
  const auto enu_from_cam = PackQuaternion(builder, pose.enu_from_cam);
  offsets.geodetic = wire::CreateGeodeticPose(
      builder, pose.position.lat_deg, pose.position.lon_deg, pose.position.height_m,
      pose.attitude.heading_deg, pose.attitude.pitch_deg, pose.attitude.roll_deg, enu_from_cam);
  const auto position = foxglove::CreateVector3(builder, p.x(), p.y(), p.z());
  const auto orientation = PackQuaternion(builder, pose.map_from_cam);
  offsets.map = foxglove::CreatePose(builder, position, orientation);
  const RowMajor6 covariance = pose.covariance_in_map;
  offsets.covariance = builder.CreateVector(covariance.data(), 36);
  const PoseSigmas sigma = SigmasOf(pose);
  offsets.sigma =
      wire::CreatePoseSigma(builder, sigma.east_m, sigma.north_m, sigma.up_m, sigma.heading_deg);
  return offsets;
}

wire::FixStatus ToWireStatus(FixStatus status) {
  switch (status) {
    case FixStatus::kFix:
      return wire::FixStatus::FIX;
    case FixStatus::kDegraded:
      return wire::FixStatus::DEGRADED;
    case FixStatus::kNoFix:
      return wire::FixStatus::NO_FIX;
  }
  return wire::FixStatus::NO_FIX;
}

}  // namespace

std::vector<std::uint8_t> PackResult(const FrameResult& result, const BundleIdentity& bundle,
                                     double decode_ms) {
  const foxglove::Time time = wire_internal::ToWireTime(result.timestamp_ns);
  Builder builder(1536);
  PoseOffsets pose;
  if (result.pose) pose = PackPose(builder, *result.pose);
  const auto reason = builder.CreateString(result.reason);
  const auto frame_id = builder.CreateString("map");
  const auto child_frame_id = builder.CreateString("cam");
  const auto best_panorama = builder.CreateString(result.best_panorama);
  const auto bundle_name = builder.CreateString(bundle.name);
  const auto bundle_id = builder.CreateString(bundle.id);
  const auto reference = wire::CreateBundleReference(builder, bundle_name, bundle_id, bundle.build);
  const StageLatency& l = result.latency;
  const auto latency =
      wire::CreateStageLatency(builder, decode_ms, l.preprocess_ms, l.features_ms, l.retrieval_ms,
                               l.matching_ms, l.pose_ms, l.total_ms + decode_ms);
  wire::FinishLocalizationResultBuffer(
      builder, wire::CreateLocalizationResult(
                   builder, &time, ToWireStatus(result.status), reason, pose.geodetic, pose.map,
                   pose.covariance, pose.sigma, frame_id, child_frame_id, result.num_inliers,
                   result.num_views, best_panorama, reference, !bundle.is_signed, latency,
                   result.num_compared, result.num_database));
  return wire_internal::TakeBytes(builder);
}

}  // namespace panofix
