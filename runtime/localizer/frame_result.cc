// What a frame's result says in files: sigmas, rows, log entries.
#include <algorithm>
#include <cmath>

#include "common/geometry/attitude.h"
#include "runtime/localizer/localizer.h"

namespace panofix {

PoseSigmas SigmasOf(const FramePose& pose) {
  const Eigen::Quaterniond enu_from_map = pose.enu_from_cam * pose.map_from_cam.conjugate();
  const Eigen::Matrix3d R = enu_from_map.toRotationMatrix();
  const Eigen::Matrix3d position = R * pose.covariance_in_map.topLeftCorner<3, 3>() * R.transpose();
  // A variance may round to just below zero.
  const auto sigma = [](double variance) { return std::sqrt(std::max(0.0, variance)); };
  return {sigma(position(0, 0)), sigma(position(1, 1)), sigma(position(2, 2)),
          sigma(pose.covariance_in_map(5, 5)) / kRadPerDeg};
}

PoseRow ToPoseRow(const FrameResult& result) {
  PoseRow row;
  row.timestamp_ns = result.timestamp_ns;
  row.status = result.status;
  row.reason = result.reason;
  row.num_inliers = result.num_inliers;
  row.num_views = result.num_views;
  row.best_panorama = result.best_panorama;
  row.latency_ms = result.latency.total_ms;
  row.map_is_unsigned = result.map_is_unsigned;
  if (result.pose) {
    const PoseSigmas sigmas = SigmasOf(*result.pose);
    row.pose = PoseColumns{result.pose->position, result.pose->attitude, result.pose->enu_from_cam,
                           sigmas.east_m,         sigmas.north_m,        sigmas.up_m,
                           sigmas.heading_deg};
  }
  return row;
}

RunLogEntry ToRunLogEntry(const FrameResult& result) {
  return {result.timestamp_ns, result.latency, result.num_compared, result.num_database};
}

}  // namespace panofix
