#include "runtime/pose/gates.h"

#include <cmath>

#include "common/base/log.h"
#include "common/geometry/attitude.h"
#include "runtime/pose/match_pool.h"

namespace panofix {

double PositionSigma_m(const PoseOutcome& outcome) {
  return std::sqrt(outcome.covariance.topLeftCorner<2, 2>().trace());
}

std::string ImplausiblePlace(const Rigid3& local_from_cam, const MapBundle& bundle,
                             const LocalFrame& local, const PoseOptions& options) {
  double nearest_m = 1e9, height_off_m = 0;
  for (const MapPanorama& panorama : bundle.panoramas()) {
    const Eigen::Vector3d d =
        local_from_cam.translation - local.FromMap(panorama.map_from_pano.translation);
    if (d.head<2>().norm() < nearest_m)
      nearest_m = d.head<2>().norm(), height_off_m = std::abs(d.z());
  }
  if (nearest_m > options.max_distance_m) return "far_from_map";
  if (height_off_m > options.max_height_off_m) return "height_implausible";
  const Attitude attitude =
      AttitudeFromEnu(local_from_cam.rotation.toRotationMatrix() * BodyFromCam().transpose());
  if (std::abs(attitude.pitch_deg) > options.max_tilt_deg ||
      std::abs(attitude.roll_deg) > options.max_tilt_deg) {
    return "tilt_implausible";
  }
  return "";
}

bool HasPlenty(const PoseOutcome& outcome, const PoseOptions& options) {
  return outcome.num_inliers >= options.plenty_inliers &&
         outcome.support >= options.plenty_support &&
         outcome.over_chance >= options.plenty_over_chance;
}

bool IsSure(const PoseOutcome& outcome, const PoseOptions& options) {
  return outcome.trusted && !outcome.degraded && outcome.num_inliers >= options.coarse_inliers &&
         outcome.over_chance >= options.coarse_over_chance &&
         PositionSigma_m(outcome) <= options.coarse_position_sigma_m;
}

std::string FailedGate(const PoseOutcome& outcome, const MapBundle& bundle, const LocalFrame& local,
                       const PoseOptions& options) {
  if (outcome.num_inliers < options.min_inliers) return "too_few_inliers";
  // Comparisons are written so that NaN fails.
  if (!(outcome.spread >= options.min_spread)) return "inliers_clustered";
  const double lead =
      outcome.num_elsewhere < options.min_inliers ? options.min_lead : options.min_clear_lead;
  if (outcome.num_inliers < lead * outcome.num_elsewhere) return kAmbiguousPlace;
  if (options.use_guided && !HasPlenty(outcome, options) &&
      !(outcome.support >= options.min_support && outcome.over_chance >= options.min_over_chance)) {
    return "landmarks_missing";
  }
  if (!(PositionSigma_m(outcome) < options.max_position_sigma_m)) return "pose_uncertain";
  if (!(outcome.chi2_per_dof <= options.max_chi2_per_dof)) return "residuals_too_large";
  return ImplausiblePlace(outcome.cam_from_local.Inverse(), bundle, local, options);
}

void DegradeDoubtful(const PoseOptions& options, PoseOutcome* outcome) {
  const bool plenty = HasPlenty(*outcome, options);
  const double least_agreement = outcome->over_chance < options.sure_over_chance && !plenty
                                     ? options.sure_agreement
                                     : options.fix_agreement;
  if (options.use_guided && (outcome->agreement < least_agreement ||
                             (outcome->over_chance < options.fix_over_chance && !plenty))) {
    outcome->degraded = true;
    outcome->reason = "landmarks_disagree";
    outcome->covariance *= options.degraded_sigma_factor * options.degraded_sigma_factor;
  } else {
    DegradeFarOrVague(options, outcome);
  }
}

void DegradeFarOrVague(const PoseOptions& options, PoseOutcome* outcome) {
  if (options.use_guided && outcome->station_distance_m > options.fix_station_distance_m) {
    outcome->degraded = true;
    outcome->reason = "beyond_map";
    outcome->covariance *= options.degraded_sigma_factor * options.degraded_sigma_factor;
  } else if (PositionSigma_m(*outcome) > options.fix_position_sigma_m) {
    outcome->degraded = true;
    outcome->reason = "pose_uncertain";
  }
}

double StationDistance_m(const StationGrid& stations, const LocalFrame& local,
                         const Rigid3& cam_from_local) {
  constexpr double kFar_m = 100;
  const Eigen::Vector3d position = local.ToMap(CentreOf(cam_from_local));
  const auto nearest = stations.Near(position, kFar_m, 1);
  if (nearest.empty()) return kFar_m;
  return (stations.position_in_map(nearest.front()) - position).head<2>().norm();
}

void LogCandidate(const PoseOutcome& outcome, const MapBundle& bundle, const LocalFrame& local) {
  const Geodetic place = bundle.frame().ToGeodetic(local.ToMap(CentreOf(outcome.cam_from_local)));
  LogDebug(Format(
      "candidate %.9f %.9f inliers %d firm %d elsewhere %d spread %.3f support %.3f over_chance "
      "%.1f "
      "chi2 %.2f sigma_m %.3f agreement %.3f coverage %.3f focal %.4f focal_sigma %.4f rival %.3f "
      "%s",
      place.lat_deg, place.lon_deg, outcome.num_inliers, outcome.num_firm, outcome.num_elsewhere,
      outcome.spread, outcome.support, outcome.over_chance, outcome.chi2_per_dof,
      PositionSigma_m(outcome), outcome.agreement, outcome.coverage, outcome.focal.error,
      outcome.focal.sigma, outcome.rival_support,
      outcome.trusted ? "trusted" : outcome.reason.c_str()));
}

}  // namespace panofix
