// The landmark layer as one run of its stages.
#include "builder/landmarks/landmark_layer.h"

#include <tbb/parallel_for.h>

#include <cmath>
#include <optional>
#include <set>
#include <stdexcept>

#include "builder/landmarks/geotag_check.h"
#include "builder/landmarks/joint_refinement.h"
#include "builder/landmarks/match_tracks.h"
#include "builder/landmarks/merge_observations.h"
#include "builder/landmarks/select_landmarks.h"
#include "builder/landmarks/triangulate.h"
#include "common/base/log.h"
#include "common/features/matcher.h"

namespace panofix {
namespace {

constexpr float kLeastSigma_m = 1e-3F;  // what the bundle can hold

void CheckInput(std::span<const LandmarkPanorama> panoramas, double focal_px) {
  if (!(focal_px > 0) || !std::isfinite(focal_px)) {
    throw std::logic_error(Format("focal_px = %g; must be above 0", focal_px));
  }
  for (std::size_t p = 0; p < panoramas.size(); ++p) {
    const Rigid3& pose = panoramas[p].local_from_pano;
    if (!pose.translation.allFinite() || !(std::abs(pose.rotation.norm() - 1) < 1e-6)) {
      throw std::logic_error(Format("panorama %zu: its pose is not finite or not a rotation", p));
    }
  }
}

// A landmark that one panorama alone vouches for: onto the refined plane, along its ray.
void Settle(const LayerInput& input, const JointRefinement& refinement, Landmark* landmark) {
  const std::size_t p = landmark->panorama, surface = landmark->surface_idx;
  const auto plane = PlaneModel::Of(input.panoramas[p], landmark->surface_idx);
  if (!plane) {
    landmark->surface_idx = 0;
  } else if (input.options.refine && !input.panoramas[p].is_fixed) {
    const Eigen::Vector3d point = landmark->point_in_pano.cast<double>();
    const PlaneSigmas sigmas{double{refinement.panoramas[p].distance_sigma_share[surface]},
                             double{refinement.panoramas[p].normal_sigma_rad[surface]}};
    const double own_m = OwnRangeSigma_m(*landmark, plane, input.errors);
    const double shared_m = SharedRangeSigma_m(point, *plane, sigmas);
    const Eigen::Vector3d moved = plane->MovePoint(point, refinement.plane_deltas[p][surface]);
    landmark->point_in_pano = moved.cast<float>();
    const double stretch = moved.norm() / point.norm();
    landmark->range_sigma_m = static_cast<float>(stretch * std::hypot(own_m, shared_m));
  }
  if (refinement.fault_m[p] > 0) {
    const double fault_m = refinement.fault_m[p];
    landmark->range_sigma_m =
        static_cast<float>(std::hypot(double{landmark->range_sigma_m}, fault_m));
    landmark->point_sigma_m =
        static_cast<float>(std::hypot(double{landmark->point_sigma_m}, fault_m));
  }
}

// Members of a track by their looks: leader clustering, the anchor's look first.
std::vector<std::vector<LandmarkRef>> Appearances(const LayerInput& input,
                                                  const MergedLandmarks& merged,
                                                  const TrackPoint& track) {
  const double limit = input.options.max_merge_descriptor_distance;
  std::vector<LandmarkRef> members = {track.anchor};
  for (const LandmarkRef ref : track.members) {
    if (ref != track.anchor) members.push_back(ref);
  }
  std::vector<std::vector<LandmarkRef>> clusters;
  for (const LandmarkRef ref : members) {
    const auto cluster = std::find_if(clusters.begin(), clusters.end(), [&](const auto& some) {
      return DescriptorDistanceSq(Get(merged, some.front()).descriptor.data(),
                                  Get(merged, ref).descriptor.data()) <= limit * limit;
    });
    cluster == clusters.end() ? clusters.push_back({ref}) : cluster->push_back(ref);
  }
  return clusters;
}

MergedLandmark FromTrack(const MergedLandmarks& merged, const TrackPoint& track,
                         const std::vector<LandmarkRef>& members) {
  MergedLandmark joined{Get(merged, members.front()), 0};
  Landmark& landmark = joined.landmark;
  landmark.panorama = track.anchor.panorama;
  landmark.point_in_pano = track.point_in_anchor.cast<float>();
  landmark.range_sigma_m = static_cast<float>(track.range_sigma_m);
  landmark.point_sigma_m = static_cast<float>(track.point_sigma_m);
  landmark.surface_idx = 0;
  landmark.num_panoramas =
      static_cast<std::uint8_t>(std::min<std::size_t>(track.members.size(), 255));
  std::vector<const std::uint8_t*> descriptors;
  std::set<std::uint32_t> views;
  double log_size = 0;
  for (const LandmarkRef ref : members) {
    const MergedLandmark& member = merged[ref.panorama][ref.idx];
    joined.response = std::max(joined.response, member.response);
    descriptors.push_back(member.landmark.descriptor.data());
    views.insert(member.landmark.views.begin(), member.landmark.views.end());
    log_size += std::log(double{member.landmark.size_m});
  }
  landmark.size_m = static_cast<float>(std::exp(log_size / static_cast<double>(members.size())));
  landmark.descriptor = MeanDescriptor(descriptors);
  landmark.views.assign(views.begin(), views.end());
  return joined;
}

// All landmarks by panorama and rank there, a track's in its anchor's place.
std::vector<MergedLandmark> Assemble(const LayerInput& input, const MergedLandmarks& merged,
                                     const JointRefinement& refinement,
                                     const std::vector<Track>& tracks) {
  std::vector<std::optional<TrackPoint>> points(tracks.size());
  tbb::parallel_for(std::size_t{0}, tracks.size(), [&](std::size_t t) {
    points[t] = TriangulateTrack(input, merged, refinement, tracks[t]);
  });
  constexpr std::uint32_t kSingle = 0xFFFFFFFF, kJoined = 0xFFFFFFFE;
  std::vector<std::vector<std::uint32_t>> place(merged.size());  // the track to put here
  for (std::size_t p = 0; p < merged.size(); ++p) place[p].assign(merged[p].size(), kSingle);
  for (std::uint32_t t = 0; t < points.size(); ++t) {
    if (!points[t]) continue;
    for (const LandmarkRef ref : points[t]->members) place[ref.panorama][ref.idx] = kJoined;
    place[points[t]->anchor.panorama][points[t]->anchor.idx] = t;
  }
  std::vector<MergedLandmark> landmarks;
  for (std::uint32_t p = 0; p < merged.size(); ++p) {
    for (std::uint32_t i = 0; i < merged[p].size(); ++i) {
      if (place[p][i] == kSingle) {
        landmarks.push_back(merged[p][i]);
        Settle(input, refinement, &landmarks.back().landmark);
      } else if (place[p][i] != kJoined) {
        const TrackPoint& track = *points[place[p][i]];
        for (const auto& members : Appearances(input, merged, track)) {
          landmarks.push_back(FromTrack(merged, track, members));
        }
      }
    }
  }
  for (MergedLandmark& m : landmarks) {
    m.landmark.range_sigma_m = std::max(kLeastSigma_m, m.landmark.range_sigma_m);
    m.landmark.point_sigma_m = std::max(kLeastSigma_m, m.landmark.point_sigma_m);
  }
  return landmarks;
}

// Numbers stay small near the panoramas, whatever frame they come in.
std::vector<LandmarkPanorama> Centred(std::span<const LandmarkPanorama> panoramas) {
  std::vector<LandmarkPanorama> centred(panoramas.begin(), panoramas.end());
  for (LandmarkPanorama& p : centred) {
    p.local_from_pano.translation -= panoramas.front().local_from_pano.translation;
  }
  return centred;
}

LandmarkLayer WithoutMerging(std::span<const LandmarkPanorama> panoramas, const LayerInput& input,
                             MergedLandmarks merged) {
  std::vector<MergedLandmark> landmarks;
  for (auto& some : merged) {
    landmarks.insert(landmarks.end(), std::make_move_iterator(some.begin()),
                     std::make_move_iterator(some.end()));
  }
  LayerInput original = input;
  original.panoramas = panoramas;
  return {SelectLandmarks(std::move(landmarks), input.options.max_per_view),
          Unrefined(original, std::vector<double>(panoramas.size(), 0.0)).panoramas};
}

}  // namespace

void LandmarkOptions::Check() const {
  const auto require = [](bool holds, const std::string& fault) {
    if (!holds) throw std::invalid_argument(fault);
  };
  require(max_merge_descriptor_distance > 0 && max_merge_descriptor_distance < 1e4,
          Format("max_merge_descriptor_distance = %g; must lie in (0, 10000)",
                 max_merge_descriptor_distance));
  require(max_per_view >= 0, Format("max_per_view = %d; must not be negative", max_per_view));
  require(max_shift_m > 0 && std::isfinite(max_shift_m),
          Format("max_shift_m = %g; must be above 0", max_shift_m));
  require(max_turn_deg > 0 && max_turn_deg < 180,
          Format("max_turn_deg = %g; must lie in (0, 180)", max_turn_deg));
}

LandmarkLayer BuildLandmarks(std::span<const LandmarkPanorama> panoramas,
                             std::span<const LandmarkObservation> observations,
                             const MapErrors& errors, double focal_px,
                             const LandmarkOptions& options) {
  options.Check();
  CheckInput(panoramas, focal_px);
  const std::vector<LandmarkPanorama> centred = Centred(panoramas);
  const LayerInput input{centred, errors, focal_px, options};
  MergedLandmarks merged = MergeObservations(input, observations);
  if (!options.merge) return WithoutMerging(panoramas, input, std::move(merged));

  const std::vector<double> fault_m = FindGeotagFaults(input, merged);
  std::vector<bool> is_excluded;
  for (const double fault : fault_m) is_excluded.push_back(fault > 0);
  const std::vector<Track> tracks = JoinTracks(MatchLandmarks(input, merged, is_excluded));
  JointRefinement refinement =
      options.refine ? RefineJointly(input, merged, tracks, fault_m) : Unrefined(input, fault_m);
  LandmarkLayer layer;
  layer.landmarks =
      SelectLandmarks(Assemble(input, merged, refinement, tracks), options.max_per_view);
  layer.panoramas = std::move(refinement.panoramas);
  for (std::size_t p = 0; p < panoramas.size(); ++p) {
    PanoramaRefinement& refined = layer.panoramas[p];
    const bool is_moved = refined.shift_m > 0 || refined.turn_deg > 0;
    // What did not move keeps its very bits.
    if (is_moved) {
      refined.local_from_pano.translation += panoramas.front().local_from_pano.translation;
    } else {
      refined.local_from_pano = panoramas[p].local_from_pano;
    }
  }
  return layer;
}

}  // namespace panofix
