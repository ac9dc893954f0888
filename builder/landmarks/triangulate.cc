#include "builder/landmarks/triangulate.h"

#include <Eigen/LU>
#include <cmath>

#include "builder/landmarks/refinement_costs.h"

namespace panofix {
namespace {

constexpr double kMaxWhitened = 4;  // of a bearing, norm of two
constexpr double kMaxOffPlane = 6;  // sigmas of every member's plane: not this surface
constexpr double kPlaneLoss = 2;    // sigmas; Cauchy, as in the joint refinement
constexpr int kIterations = 6;

// What a member says of the point, in the refined pose of its panorama.
struct Sight {
  LandmarkRef ref;
  Rigid3 pano_from_local;
  Eigen::Vector3d ray;
  double range_m = 0;                 // as the depth has it, unrefined
  double keypoint_m = 0, pose_m = 0;  // 1-sigma errors across the ray, of the keypoint and the pose
  double sigma_rad = 0;               // of the bearing, relative to the anchor's pose
  DepthPrior prior;
};

Sight SightOf(const LayerInput& input, const MergedLandmarks& merged,
              const JointRefinement& refinement, LandmarkRef ref) {
  const Landmark& landmark = Get(merged, ref);
  const Eigen::Vector3d point = landmark.point_in_pano.cast<double>();
  const std::size_t p = ref.panorama, surface = landmark.surface_idx;
  Sight sight{};
  sight.ref = ref;
  sight.pano_from_local = refinement.panoramas[p].local_from_pano.Inverse();
  sight.ray = point.normalized();
  sight.range_m = point.norm();
  const double turn_m = input.errors.panorama_heading_sigma_deg * kRadPerDeg * sight.range_m;
  sight.pose_m =
      refinement.pose_error_left[p] * std::hypot(input.errors.panorama_position_sigma_m, turn_m);
  sight.keypoint_m = double{landmark.point_sigma_m};
  const auto plane = PlaneModel::Of(input.panoramas[p], landmark.surface_idx);
  const Eigen::Vector3d delta =
      plane ? refinement.plane_deltas[p][surface] : Eigen::Vector3d::Zero();
  sight.prior = DepthPriorOf(landmark, plane, delta, input.errors);
  if (plane) {
    const PlaneSigmas sigmas{double{refinement.panoramas[p].distance_sigma_share[surface]},
                             double{refinement.panoramas[p].normal_sigma_rad[surface]}};
    const double shared_m =
        SharedRangeSigma_m(point, *plane, sigmas) * std::abs(plane->normal.dot(sight.ray));
    sight.prior.sigma_m = std::hypot(sight.prior.sigma_m, shared_m);
  }
  return sight;
}

struct Solution {
  Eigen::Vector3d point;
  Eigen::Matrix3d covariance;
};

// Gauss-Newton in 3-D. The members' planes err alike (relief is the wall's): all together count as
// one.
std::optional<Solution> Solve(const std::vector<Sight>& sights, const Eigen::Vector3d& start) {
  Solution solution{start, {}};
  const double plane_share = 1.0 / static_cast<double>(sights.size());
  for (int k = 0; k < kIterations; ++k) {
    Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
    Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
    for (const Sight& sight : sights) {
      const Eigen::Matrix3d rotation = sight.pano_from_local.rotation.toRotationMatrix();
      const Eigen::Vector3d x = sight.pano_from_local * solution.point;
      Eigen::Vector2d offset;
      Matrix23d by_point;
      if (!BearingOffset(sight.ray, x, &offset, &by_point)) return std::nullopt;
      by_point = by_point * rotation / sight.sigma_rad;
      information += by_point.transpose() * by_point;
      gradient += by_point.transpose() * (offset / sight.sigma_rad);
      const double off_plane = (sight.prior.normal.dot(x) - sight.prior.d_m) / sight.prior.sigma_m;
      const double weight = plane_share / (1 + off_plane * off_plane / (kPlaneLoss * kPlaneLoss));
      const Eigen::Vector3d row = rotation.transpose() * sight.prior.normal / sight.prior.sigma_m;
      information += weight * row * row.transpose();
      gradient += weight * off_plane * row;
    }
    solution.covariance = information.inverse();
    solution.point -= solution.covariance * gradient;
    if (!solution.point.allFinite()) return std::nullopt;
  }
  return solution;
}

// The point is wanted in the anchor's frame: its pose is no error, but part of everyone else's.
void WeighFrom(const Sight& anchor, std::vector<Sight>* sights) {
  for (Sight& sight : *sights) {
    const double pose_m = &sight == &anchor ? 0 : std::hypot(sight.pose_m, anchor.pose_m);
    sight.sigma_rad = std::hypot(sight.keypoint_m, pose_m) / sight.range_m;
  }
}

double Whitened(const Sight& sight, const Eigen::Vector3d& point) {
  const Eigen::Vector3d x = sight.pano_from_local * point;
  return std::atan2(sight.ray.cross(x).norm(), sight.ray.dot(x)) / sight.sigma_rad;
}

double OffPlane(const Sight& sight, const Eigen::Vector3d& point) {
  return std::abs(sight.prior.normal.dot(sight.pano_from_local * point) - sight.prior.d_m) /
         sight.prior.sigma_m;
}

TrackPoint Finish(const std::vector<Sight>& sights, const Sight& anchor, const Solution& solution) {
  TrackPoint result;
  for (const Sight& sight : sights) result.members.push_back(sight.ref);
  result.anchor = anchor.ref;
  result.point_in_anchor = anchor.pano_from_local * solution.point;
  const Eigen::Vector3d ray =
      anchor.pano_from_local.rotation.conjugate() * result.point_in_anchor.normalized();
  const double along_sq = ray.dot(solution.covariance * ray);
  result.range_sigma_m = std::sqrt(along_sq);
  result.point_sigma_m = std::sqrt(std::max(0.0, solution.covariance.trace() - along_sq) / 2);
  return result;
}

}  // namespace

std::optional<TrackPoint> TriangulateTrack(const LayerInput& input, const MergedLandmarks& merged,
                                           const JointRefinement& refinement, const Track& track) {
  std::vector<Sight> sights;
  for (const LandmarkRef ref : track.members) {
    if (refinement.fault_m[ref.panorama] > 0) continue;
    sights.push_back(SightOf(input, merged, refinement, ref));
  }
  while (sights.size() >= 2) {
    const Sight& anchor =
        *std::min_element(sights.begin(), sights.end(),
                          [](const Sight& a, const Sight& b) { return a.range_m < b.range_m; });
    WeighFrom(anchor, &sights);
    const double range_m = anchor.prior.d_m / anchor.prior.normal.dot(anchor.ray);
    if (!(range_m > kMinDepth_m)) return std::nullopt;
    const auto solution = Solve(sights, anchor.pano_from_local.Inverse() * (range_m * anchor.ray));
    if (!solution) return std::nullopt;
    const auto worst =
        std::max_element(sights.begin(), sights.end(), [&](const Sight& a, const Sight& b) {
          return Whitened(a, solution->point) < Whitened(b, solution->point);
        });
    if (Whitened(*worst, solution->point) > kMaxWhitened) {
      sights.erase(worst);
      continue;
    }
    const bool is_off = std::all_of(sights.begin(), sights.end(), [&](const Sight& s) {
      return OffPlane(s, solution->point) > kMaxOffPlane;
    });
    if (is_off) return std::nullopt;
    return Finish(sights, anchor, *solution);
  }
  return std::nullopt;
}

}  // namespace panofix
