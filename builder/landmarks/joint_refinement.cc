#include "builder/landmarks/joint_refinement.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <map>

#include "builder/landmarks/joint_solver.h"
#include "builder/landmarks/refinement_costs.h"

namespace panofix {
namespace {

constexpr int kTracksPerPlane = 50, kTracksPerRaster = 500;
constexpr int kMaxRounds = 4;                  // of flagging
constexpr int kFewestToFlag = 8;               // tracks without which bad residuals prove nothing
constexpr double kBadWhitened = 4;             // median; 1.2 where all is well
constexpr double kLeastDistanceShare = 0.003;  // poses' scale error, which the planes cannot see
constexpr double kLeastNormal_rad = 0.001;
constexpr double kPoseErrorLeft = 0.45;  // of the geotag's, measured on synthetic streets
constexpr int kFewestForPose = 8;

// Tracks of most panoramas first; each plane gets its quota, so that none goes without.
std::vector<JointTrack> ChooseTracks(const LayerInput& input, const MergedLandmarks& merged,
                                     const std::vector<Track>& tracks,
                                     const std::vector<double>& fault_m) {
  std::vector<Track> usable;
  for (const Track& track : tracks) {
    Track kept;
    bool can_move = false;
    for (const LandmarkRef ref : track.members) {
      if (fault_m[ref.panorama] > 0) continue;
      kept.members.push_back(ref);
      can_move |= !input.panoramas[ref.panorama].is_fixed;
    }
    if (can_move && kept.members.size() >= 2) usable.push_back(std::move(kept));
  }
  std::stable_sort(usable.begin(), usable.end(), [](const Track& a, const Track& b) {
    return a.members.size() > b.members.size();
  });
  std::map<SurfaceRef, int> count;
  std::vector<JointTrack> chosen;
  for (const Track& track : usable) {
    bool is_wanted = false;
    for (const LandmarkRef ref : track.members) {
      const std::uint8_t surface = Get(merged, ref).surface_idx;
      const int quota = PlaneModel::Of(input.panoramas[ref.panorama], surface) ? kTracksPerPlane
                                                                               : kTracksPerRaster;
      is_wanted |= count[{ref.panorama, surface}]++ < quota;
    }
    if (is_wanted) chosen.push_back(MakeJointTrack(merged, track));
  }
  return chosen;
}

double Median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

struct ResidualMedians {
  std::vector<double> px, whitened;
  std::vector<int> num_tracks;
};

ResidualMedians MediansOf(const LayerInput& input, const MergedLandmarks& merged,
                          const JointState& state) {
  const std::size_t n = input.panoramas.size();
  std::vector<std::vector<double>> px(n), whitened(n);
  ResidualMedians medians{{}, {}, std::vector<int>(n, 0)};
  for (const JointTrack& track : state.tracks) {
    ++medians.num_tracks[track.anchor.panorama];
    for (const LandmarkRef other : track.others) {
      ++medians.num_tracks[other.panorama];
      const BearingError error = BearingErrorOf(input, merged, state, track, other);
      for (const std::uint32_t p : {track.anchor.panorama, other.panorama}) {
        px[p].push_back(error.px);
        whitened[p].push_back(error.whitened);
      }
    }
  }
  for (std::size_t p = 0; p < n; ++p) {
    medians.px.push_back(Median(std::move(px[p])));
    medians.whitened.push_back(Median(std::move(whitened[p])));
  }
  return medians;
}

// Flags what cannot be reconciled; true where there was any.
bool FlagMisfits(const LayerInput& input, const JointState& state, const ResidualMedians& after,
                 std::vector<double>* fault_m) {
  bool any = false;
  for (std::size_t p = 0; p < input.panoramas.size(); ++p) {
    if (input.panoramas[p].is_fixed || (*fault_m)[p] > 0) continue;
    const double shift_m = state.corrections[p].head<3>().norm();
    const double turn_deg = state.corrections[p].tail<3>().norm() / kRadPerDeg;
    const bool is_bad = after.num_tracks[p] >= kFewestToFlag && after.whitened[p] > kBadWhitened;
    if (shift_m <= input.options.max_shift_m && turn_deg <= input.options.max_turn_deg && !is_bad) {
      continue;
    }
    (*fault_m)[p] = std::max(input.options.max_shift_m, shift_m);
    any = true;
  }
  return any;
}

// Posterior of each plane with its tracks' points free along their rays, poses held.
std::map<SurfaceRef, Eigen::Matrix3d> PlaneCovariances(const LayerInput& input,
                                                       const MergedLandmarks& merged,
                                                       const JointState& state) {
  const PlaneSigmas prior = PriorSigmas(input.errors);
  const Eigen::Vector3d sigmas(prior.distance_share, prior.normal_rad, prior.normal_rad);
  std::map<SurfaceRef, Eigen::Matrix3d> information;
  for (const auto& [surface, delta] : state.planes) {
    information[surface] = sigmas.cwiseMax(1e-9).cwiseAbs2().cwiseInverse().asDiagonal();
  }
  for (const JointTrack& track : state.tracks) {
    const double bearings = RangeInformation(input, merged, state, track);
    if (!(bearings > 0)) continue;
    const Eigen::Vector3d anchor_ray =
        input.panoramas[track.anchor.panorama].local_from_pano.rotation *
        Get(merged, track.anchor).point_in_pano.cast<double>().normalized();
    std::vector<LandmarkRef> members = track.others;
    members.push_back(track.anchor);
    for (const LandmarkRef ref : members) {
      const SurfaceRef surface{ref.panorama, Get(merged, ref).surface_idx};
      const auto entry = information.find(surface);
      if (entry == information.end()) continue;
      const PlaneModel plane = *PlaneModel::Of(input.panoramas[ref.panorama], surface.second);
      const Eigen::Quaterniond& rotation = input.panoramas[ref.panorama].local_from_pano.rotation;
      const double along_normal = (rotation * plane.normal).dot(anchor_ray);
      const double sigma_m = std::hypot(JointDepthPrior(input, merged, track, ref, true).sigma_m,
                                        along_normal / std::sqrt(bearings));
      const Eigen::RowVector3d row =
          plane.Row(Get(merged, ref).point_in_pano.cast<double>()) / sigma_m;
      entry->second += row.transpose() * row;
    }
  }
  for (auto& [surface, matrix] : information) matrix = matrix.inverse().eval();
  return information;
}

void WriteResult(const LayerInput& input, const MergedLandmarks& merged, const JointState& state,
                 JointRefinement* result) {
  for (std::size_t p = 0; p < input.panoramas.size(); ++p) {
    PanoramaRefinement& panorama = result->panoramas[p];
    if (input.panoramas[p].is_fixed || panorama.is_flagged || panorama.num_tracks == 0) continue;
    panorama.local_from_pano = Corrected(input.panoramas[p].local_from_pano, state.corrections[p]);
    panorama.shift_m = state.corrections[p].head<3>().norm();
    panorama.turn_deg = state.corrections[p].tail<3>().norm() / kRadPerDeg;
    if (panorama.num_tracks >= kFewestForPose) result->pose_error_left[p] = kPoseErrorLeft;
  }
  for (const auto& [surface, covariance] : PlaneCovariances(input, merged, state)) {
    const auto [p, idx] = surface;
    PanoramaRefinement& panorama = result->panoramas[p];
    if (input.panoramas[p].is_fixed || panorama.is_flagged) continue;
    const Eigen::Vector3d& delta = state.planes.at(surface);
    result->plane_deltas[p][idx] = delta;
    panorama.planes[idx] = PlaneModel::Of(input.panoramas[p], idx)->Refined(delta);
    const PlaneSigmas prior = PriorSigmas(input.errors);
    const double tilt_rad = std::sqrt(std::max(covariance(1, 1), covariance(2, 2)));
    // A floor, but never worse than what was known before.
    panorama.distance_sigma_share[idx] = static_cast<float>(
        std::min(prior.distance_share, std::max(kLeastDistanceShare, std::sqrt(covariance(0, 0)))));
    panorama.normal_sigma_rad[idx] =
        static_cast<float>(std::min(prior.normal_rad, std::max(kLeastNormal_rad, tilt_rad)));
  }
}

}  // namespace

JointRefinement Unrefined(const LayerInput& input, const std::vector<double>& fault_m) {
  JointRefinement result;
  result.fault_m = fault_m;
  result.pose_error_left.assign(input.panoramas.size(), 1.0);
  const PlaneSigmas sigmas = PriorSigmas(input.errors);
  for (std::size_t p = 0; p < input.panoramas.size(); ++p) {
    const LandmarkPanorama& panorama = input.panoramas[p];
    PanoramaRefinement refinement;
    refinement.local_from_pano = panorama.local_from_pano;
    refinement.planes = panorama.planes;
    refinement.distance_sigma_share.assign(panorama.planes.size(),
                                           static_cast<float>(sigmas.distance_share));
    refinement.normal_sigma_rad.assign(panorama.planes.size(),
                                       static_cast<float>(sigmas.normal_rad));
    refinement.is_flagged = fault_m[p] > 0;
    result.panoramas.push_back(std::move(refinement));
    result.plane_deltas.emplace_back(panorama.planes.size(), Eigen::Vector3d::Zero());
  }
  return result;
}

JointRefinement RefineJointly(const LayerInput& input, const MergedLandmarks& merged,
                              const std::vector<Track>& tracks,
                              const std::vector<double>& fault_m) {
  JointRefinement result = Unrefined(input, fault_m);
  JointState state;
  for (int round = 0; round < kMaxRounds; ++round) {
    state = {std::vector<Vector6d>(input.panoramas.size(), Vector6d::Zero()),
             {},
             ChooseTracks(input, merged, tracks, result.fault_m)};
    const ResidualMedians before = MediansOf(input, merged, state);
    SolveJointly(input, merged, &state);
    const ResidualMedians after = MediansOf(input, merged, state);
    for (std::size_t p = 0; p < result.panoramas.size(); ++p) {
      if (result.fault_m[p] > 0) continue;  // keeps what it was flagged for
      result.panoramas[p].residual_before_px = before.px[p];
      result.panoramas[p].residual_after_px = after.px[p];
      result.panoramas[p].num_tracks = after.num_tracks[p];
    }
    if (!FlagMisfits(input, state, after, &result.fault_m)) break;
  }
  for (std::size_t p = 0; p < result.panoramas.size(); ++p) {
    result.panoramas[p].is_flagged = result.fault_m[p] > 0;
  }
  WriteResult(input, merged, state, &result);
  return result;
}

}  // namespace panofix
