#pragma once
// Options and outcome of the pose estimation.

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "common/estimate/focal_check.h"
#include "common/estimate/pnp.h"
#include "common/estimate/refine.h"
#include "runtime/pose/guided_matching.h"

namespace panofix {

struct PoseOptions {
  RansacOptions ransac;  // a view's search; the focal length and seed are set by the caller
  RefineOptions refine;
  BundleOptions bundle;
  // Last fixes whose matches join the final adjustment. Off: on generated drives the median error
  // moved by about a centimetre at most, either way, and the sigmas grew more optimistic.
  std::size_t past_frames = 0;
  double past_age_s = 3;   // none older
  bool use_guided = true;  // search landmarks around the first pose; needs RootSIFT
  GuidedOptions guided;
  LandmarkSetOptions landmarks;
  // Stations whose landmarks make the pose of a find that is not sure; what speaks for it is
  // counted among `landmarks` alone, as ever.
  std::size_t wide_stations = 10;
  bool use_wide = true;
  double around_px = 130;  // window around a prediction: a turn of some degrees, a metre or two
  double around_view_px =
      300;                    // and around a retrieved view's own pose: half the step between views
  double around_view_m = 15;  // and how far a camera may be from there
  int max_view_poses = 5;     // retrieved views whose poses are tried so
  int min_view_inliers = 8;   // consensus that makes a view's pose a hypothesis
  int min_inliers = 16;       // distinct keypoints that agree with the final pose
  double min_spread = 0.05;   // of the inliers over the image: 1 = uniform (see ImageSpread)
  double min_lead = 1.5;      // inliers over those of the best pose elsewhere: look-alikes end here
  double min_clear_lead = 3;  // the same where those elsewhere would do for a pose themselves
  double elsewhere_m = 4.0;   // what counts as elsewhere
  double elsewhere_rad = 1;   // or as another direction: a street may look alike from both ends
  double min_prior_share =
      0.05;                  // of the other place's prior: with less, the past rules a rival out
  double rival_place_m = 8;  // places of retrieval so far from each other are asked
  // What a pose must show that no prediction led to.
  int find_inliers = 50;
  double find_support = 0.08;
  double find_over_chance = 8;
  double find_coverage = 0.35;
  // Or so many firm matches and distinct keypoints: twice what finds had that passed the gates
  // beyond 5 m of the truth, in towns that do not repeat.
  int find_firm = 60;
  // Firm matches of finds that may confirm each other; those whose depth is a plane's suit poses a
  // metre or two off.
  int min_firm = 20;
  // A tracked pose with fewer takes more stations and is joined to what the last frames saw.
  int weak_inliers = 50;
  // What a tracked pose must show that the frame at half its size led to; else all of it is looked
  // at.
  int coarse_inliers = 40;
  double coarse_over_chance = 8;
  double coarse_position_sigma_m = 0.15;
  double max_track_shift_m = 4;  // of a pose from the prediction that led to it
  double max_rival_share =
      0.2;  // of the support of a found pose: a rival with more is a look-alike
  // A rival of under find_inliers has so many of the found pose's firm matches: a row of equal
  // windows lends a wrong pose as large a share of the few landmarks it shows, and none of the rest
  // of the picture.
  double min_rival_firm_share = 0.33;
  int max_rivals = 4;     // poses elsewhere that are looked at
  int guided_rounds = 3;  // searches, each from the pose of the last, in windows half as wide
  // A pose whose support is not this far over chance is compared with poses beside it first.
  double sure_over_chance = 8.0;
  double climb_step_m = 0.7;  // step of that comparison, halved as it ends
  int max_climbs = 6;
  int max_candidates = 4;  // distinct hypotheses that guided matching is tried on
  int sure_inliers = 80;   // a hypothesis with more needs no rival tried
  // With guided matching: landmarks found beyond chance over landmarks visible, and found over
  // chance.
  double min_support = 0.03;
  double min_over_chance = 4.0;
  // Where texture repeats (brick, paving) chance is high however right the pose is. So many inliers
  // with that much support, this far over chance, were not seen at a wrong pose but in look-alikes,
  // which are told by their rivals.
  int plenty_inliers = 60;
  double plenty_support = 0.15;
  double plenty_over_chance = 2.5;
  // A trusted pose is only degraded where few of the guided matches agree with it, or not many
  // while chance is near: the map's geometry is wrong there in a way that no residual shows. Its
  // sigmas grow tenfold.
  double fix_agreement = 0.5;
  double sure_agreement = 0.58;  // asked where over_chance is below sure_over_chance
  double fix_over_chance = 4.5;
  // So far from the nearest station landmarks are seen from one side only, far away and all with
  // the same errors.
  double fix_station_distance_m = 6;
  double degraded_sigma_factor = 10;
  double max_position_sigma_m = 1.0;  // beyond, no fix
  double fix_position_sigma_m = 0.5;  // beyond, only degraded
  double max_chi2_per_dof = 3.0;
  double max_height_off_m = 2.5;  // camera's height against the nearest panorama's
  double max_tilt_deg = 25;       // pitch or roll of a camera on a vehicle
  double max_distance_m = 40;     // from the nearest panorama
  // throws std::invalid_argument
  void Check() const;
};

struct PoseOutcome {
  bool found = false;
  bool trusted = false;   // passes every gate; else `reason` says which failed
  bool degraded = false;  // trusted, but `reason` says why its covariance was widened
  std::string reason;     // snake_case word
  Rigid3 cam_from_local;
  Matrix6d covariance = Matrix6d::Zero();  // of the camera's pose in the local frame
  bool unconfirmed = false;  // not trusted only because one frame alone is too little evidence
  int num_inliers = 0;       // distinct keypoints
  int num_firm = 0;          // matches that agree, of landmarks that no depth plane places
  // Of these with matches of the nearest stations (and of retrieved views, where the pose was not
  // made of more stations); 0 without guided matching.
  int num_near_inliers = 0;
  double support = 0;  // share of visible landmarks found beyond chance; 0 without guided matching
  double over_chance = 0;         // landmarks found over those found in decoy windows
  double coverage = 0;            // SupportedShare of the last guided search
  double station_distance_m = 0;  // from the nearest station
  double spread = 0;              // ImageSpread of the inliers
  double chi2_per_dof = 0;
  FocalCheck focal;                  // what the matches say of the stated focal length
  double agreement = 0;              // share of the guided matches that agree with the pose
  int num_elsewhere = 0;             // inliers of the best pose elsewhere, before guided matching
  double rival_support = 0;          // support of the best pose elsewhere
  double unmapped_m = 0;             // way since landmarks of the map last had a say
  std::vector<std::uint32_t> views;  // views with inliers, most first
  std::uint32_t best_view = 0;
  std::vector<Correspondence> agreed;  // matches of the final adjustment that agree with the pose
};

}  // namespace panofix
