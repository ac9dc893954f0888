// panofix.pose.v1, unpacking: every number of a result is checked, for it ends in files and on
// maps.

#include <cmath>

#include "runtime/service/messages.h"
#include "runtime/service/wire_internal.h"
#include "schemas/LocalizationResult_generated.h"

namespace panofix {
namespace {

using wire_internal::Bad;

// A quaternion further from unit length than this was not written as a rotation.
constexpr double kUnitTolerance = 1e-6;
constexpr double kMaxHeightM = 1e5, kMaxSigma = 1e6, kMaxLatencyMs = 1e9;

Status InRange(double value, double low, double high, const char* field) {
  if (value >= low && value <= high) return {};  // false for NaN
  return Bad(Format("LocalizationResult.%s: %g; must lie in %g..%g", field, value, low, high));
}

Status UnpackQuaternion(const foxglove::Quaternion* in, const char* field, Eigen::Quaterniond& q) {
  if (in == nullptr) return Bad(std::string("LocalizationResult.") + field + " is missing");
  q = Eigen::Quaterniond(in->w(), in->x(), in->y(), in->z());
  if (!(std::abs(q.norm() - 1) <= kUnitTolerance)) {
    return Bad(std::string("LocalizationResult.") + field + " is not a unit quaternion");
  }
  return {};
}

Status UnpackGeodetic(const wire::GeodeticPose& in, FramePose& pose) {
  pose.position = {in.latitude_deg(), in.longitude_deg(), in.altitude_m()};
  pose.attitude = {in.heading_deg(), in.pitch_deg(), in.roll_deg()};
  struct Field {
    double value, low, high;
    const char* name;
  };
  for (const Field& field :
       {Field{in.latitude_deg(), -90, 90, "latitude_deg"},
        Field{in.longitude_deg(), -180, 180, "longitude_deg"},
        Field{in.altitude_m(), -kMaxHeightM, kMaxHeightM, "altitude_m"},
        Field{in.heading_deg(), -360, 360, "heading_deg"},
        Field{in.pitch_deg(), -90, 90, "pitch_deg"}, Field{in.roll_deg(), -180, 180, "roll_deg"}}) {
    if (Status s = InRange(field.value, field.low, field.high, field.name); !s.ok()) return s;
  }
  return UnpackQuaternion(in.enu_from_cam(), "geodetic_pose.enu_from_cam", pose.enu_from_cam);
}

Status UnpackMapPose(const foxglove::Pose& in, FramePose& pose) {
  if (in.position() == nullptr) return Bad("LocalizationResult.map_pose.position is missing");
  pose.position_in_map = {in.position()->x(), in.position()->y(), in.position()->z()};
  if (!pose.position_in_map.allFinite()) {
    return Bad("LocalizationResult.map_pose.position is not finite");
  }
  return UnpackQuaternion(in.orientation(), "map_pose.orientation", pose.map_from_cam);
}

Status UnpackCovariance(const flatbuffers::Vector<double>& in, FramePose& pose) {
  if (in.size() != 36) {
    return Bad(Format("LocalizationResult.covariance: %u numbers; must be 36", in.size()));
  }
  for (flatbuffers::uoffset_t i = 0; i < 36; ++i) pose.covariance_in_map(i / 6, i % 6) = in.Get(i);
  if (!pose.covariance_in_map.allFinite()) {
    return Bad("LocalizationResult.covariance is not finite");
  }
  return {};
}

Status UnpackSigma(const wire::PoseSigma& in, PoseColumns& columns) {
  columns.sigma_east_m = in.east_m(), columns.sigma_north_m = in.north_m();
  columns.sigma_up_m = in.up_m(), columns.sigma_heading_deg = in.heading_deg();
  for (const double value : {in.east_m(), in.north_m(), in.up_m(), in.heading_deg()}) {
    if (Status s = InRange(value, 0, kMaxSigma, "sigma"); !s.ok()) return s;
  }
  return {};
}

Status UnpackPose(const wire::LocalizationResult& in, ReceivedResult& out) {
  const bool whole = in.geodetic_pose() != nullptr && in.map_pose() != nullptr &&
                     in.covariance() != nullptr && in.sigma() != nullptr;
  const bool none = in.geodetic_pose() == nullptr && in.map_pose() == nullptr &&
                    in.covariance() == nullptr && in.sigma() == nullptr;
  if (out.row.status == FixStatus::kNoFix) {
    return none ? Status() : Bad("LocalizationResult: status NO_FIX with a pose");
  }
  if (!whole) return Bad("LocalizationResult: a pose without all of its four parts");
  FramePose pose;
  PoseColumns columns;
  if (Status s = UnpackGeodetic(*in.geodetic_pose(), pose); !s.ok()) return s;
  if (Status s = UnpackMapPose(*in.map_pose(), pose); !s.ok()) return s;
  if (Status s = UnpackCovariance(*in.covariance(), pose); !s.ok()) return s;
  if (Status s = UnpackSigma(*in.sigma(), columns); !s.ok()) return s;
  columns.position = pose.position;
  columns.attitude = pose.attitude;
  columns.enu_from_cam = pose.enu_from_cam;
  out.row.pose = columns;
  out.result.pose = pose;
  return {};
}

Status UnpackStatus(wire::FixStatus in, FixStatus& status) {
  switch (in) {
    case wire::FixStatus::FIX:
      status = FixStatus::kFix;
      return {};
    case wire::FixStatus::DEGRADED:
      status = FixStatus::kDegraded;
      return {};
    case wire::FixStatus::NO_FIX:
      status = FixStatus::kNoFix;
      return {};
  }
  return Bad(Format("LocalizationResult.status: %d is unknown; update this program",
                    static_cast<int>(in)));
}

Status UnpackCounts(const wire::LocalizationResult& in, ReceivedResult& out) {
  if (in.num_inliers() < 0 || in.num_views() < 0 || in.num_compared() < 0 ||
      in.num_database() < 0) {
    return Bad("LocalizationResult: a count is negative");
  }
  out.row.num_inliers = out.result.num_inliers = in.num_inliers();
  out.row.num_views = out.result.num_views = in.num_views();
  out.result.num_compared = in.num_compared();
  out.result.num_database = in.num_database();
  return {};
}

Status UnpackLatency(const wire::StageLatency* in, ReceivedResult& out) {
  if (in == nullptr) return {};
  for (const double value :
       {in->decode_ms(), in->preprocess_ms(), in->features_ms(), in->retrieval_ms(),
        in->matching_ms(), in->pose_ms(), in->total_ms()}) {
    if (Status s = InRange(value, 0, kMaxLatencyMs, "latency"); !s.ok()) return s;
  }
  out.result.latency = {in->preprocess_ms(), in->features_ms(), in->retrieval_ms(),
                        in->matching_ms(),   in->pose_ms(),     in->total_ms()};
  out.row.latency_ms = in->total_ms();
  out.decode_ms = in->decode_ms();
  return {};
}

Status UnpackTexts(const wire::LocalizationResult& in, ReceivedResult& out) {
  struct Field {
    const flatbuffers::String* text;
    const char* name;
    std::string* target;
  };
  const wire::BundleReference* bundle = in.bundle();
  for (const Field& field :
       {Field{in.reason(), "reason", &out.row.reason},
        Field{in.best_panorama(), "best_panorama", &out.row.best_panorama},
        Field{bundle ? bundle->name() : nullptr, "bundle.name", &out.bundle.name},
        Field{bundle ? bundle->id() : nullptr, "bundle.id", &out.bundle.id}}) {
    auto text = wire_internal::Text(field.text, field.name);
    if (!text.ok()) return text.status();
    *field.target = *text;
  }
  out.result.reason = out.row.reason;
  out.result.best_panorama = out.row.best_panorama;
  out.bundle.build = bundle ? bundle->build() : 0;
  out.bundle.is_signed = !in.map_is_unsigned();
  out.row.map_is_unsigned = out.result.map_is_unsigned = in.map_is_unsigned();
  return {};
}

}  // namespace

Result<ReceivedResult> UnpackResult(const WireBytes& payload) {
  const WireBytes aligned = payload.Aligned();
  const auto* in = wire_internal::VerifiedRoot<wire::LocalizationResult>(
      aligned.bytes, wire::LocalizationResultIdentifier());
  if (in == nullptr) {
    return Bad(Format("pose payload of %zu bytes is no LocalizationResult with file identifier %s",
                      aligned.bytes.size(), wire::LocalizationResultIdentifier()));
  }
  ReceivedResult out;
  auto time = wire_internal::FromWireTime(in->timestamp(), "LocalizationResult");
  if (!time.ok()) return time.status();
  out.row.timestamp_ns = out.result.timestamp_ns = *time;
  if (Status s = UnpackStatus(in->status(), out.row.status); !s.ok()) return s;
  out.result.status = out.row.status;
  if (Status s = UnpackPose(*in, out); !s.ok()) return s;
  if (Status s = UnpackCounts(*in, out); !s.ok()) return s;
  if (Status s = UnpackLatency(in->latency(), out); !s.ok()) return s;
  if (Status s = UnpackTexts(*in, out); !s.ok()) return s;
  return out;
}

}  // namespace panofix
