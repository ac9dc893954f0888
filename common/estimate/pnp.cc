#include "common/estimate/pnp.h"

#include <cmath>
#include <opencv2/calib3d.hpp>

#include "common/estimate/projection.h"

namespace panofix {

bool SolveEpnp(std::span<const Correspondence> matches, Rigid3* cam_from_map) {
  if (matches.size() < 4) return false;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const Correspondence& match : matches) {
    if (!match.point_in_map.allFinite() || !match.bearing_in_cam.allFinite()) return false;
    centre += match.point_in_map / static_cast<double>(matches.size());
  }
  std::vector<cv::Point3d> points;
  std::vector<cv::Point2d> bearings;
  points.reserve(matches.size()), bearings.reserve(matches.size());
  for (const Correspondence& match : matches) {
    const Eigen::Vector3d point = match.point_in_map - centre;
    points.emplace_back(point.x(), point.y(), point.z());
    bearings.emplace_back(match.bearing_in_cam.x(), match.bearing_in_cam.y());
  }
  try {
    const cv::Matx33d identity = cv::Matx33d::eye();
    cv::Vec3d rotation_vector, translation;
    if (!cv::solvePnP(points, bearings, identity, cv::noArray(), rotation_vector, translation,
                      false, cv::SOLVEPNP_EPNP)) {
      return false;
    }
    const Eigen::Quaterniond rotation =
        ExpSo3({rotation_vector[0], rotation_vector[1], rotation_vector[2]});
    *cam_from_map =
        Rigid3(rotation,
               Eigen::Vector3d(translation[0], translation[1], translation[2]) - rotation * centre);
  } catch (const cv::Exception&) {
    return false;
  }
  if (!cam_from_map->rotation.coeffs().allFinite() || !cam_from_map->translation.allFinite()) {
    return false;
  }
  return (*cam_from_map * centre).z() > 0;
}

}  // namespace panofix
