// The steps of a frame.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "common/base/log.h"
#include "common/geometry/attitude.h"
#include "runtime/localizer/frame_sight.h"
#include "runtime/localizer/localizer_impl.h"
#include "runtime/pose/gates.h"

namespace panofix {
namespace {

// Where belief is so concentrated, retrieval looks there first.
constexpr double kWindowShare = 0.8;  // of the belief on the map
constexpr std::size_t kWindowPanoramas = 12;
constexpr double kWindowBelief = 0.5;  // that all of them must hold
constexpr float kRivalVotes = 0.4F;    // of the votes at the pose's own place: fewer are no rival
constexpr double kPriorRadius_m =
    15;  // belief within speaks for a place: panoramas stand this far apart

Rigid3 CamFromLocal(const Rigid3& map_from_cam, const LocalFrame& local) {
  return Rigid3(map_from_cam.rotation, local.FromMap(map_from_cam.translation)).Inverse();
}

}  // namespace

PlaceGraph PlaceGraphOf(const MapBundle& bundle) {
  PlaceGraph graph;
  for (const MapPanorama& panorama : bundle.panoramas()) {
    graph.positions_in_map.push_back(panorama.map_from_pano.translation);
    graph.links.push_back(panorama.links);
  }
  return graph;
}

PoseOptions CoarseOptions(PoseOptions options) {
  options.use_wide = false;
  return options;
}

FrameFeatures Localizer::Impl::ExtractFeatures(const GrayImage& image, Detail detail,
                                               StageLatency* latency) const {
  Stopwatch watch;
  FrameFeatures features;
  const FeatureOptions& feature_options = bundle->manifest().features;
  if (detail == Detail::kCoarse) {
    features.sift = ExtractCoarseSift(image, feature_options);
    features.smallest_px = kSmallestCoarseRegion_px;
  } else {
    features.sift = ExtractSift(image, feature_options);
  }
  for (const Keypoint& k : features.sift.keypoints) {
    features.bearings.push_back(camera.Normalize({double{k.x_px}, double{k.y_px}}));
  }
  latency->features_ms += watch.Lap();
  return features;
}

BagOfWords Localizer::Impl::MakeBag(const GrayImage& image, const FrameFeatures& features,
                                    StageLatency* latency) const {
  Stopwatch watch;
  const FeatureSet mser = ExtractMser(image, bundle->manifest().features);
  const Vocabulary& vocabulary = bundle->vocabulary();
  BagOfWords bag = vocabulary.Bag(vocabulary.SiftWords(features.sift), vocabulary.MserWords(mser));
  latency->features_ms += watch.Lap();
  return bag;
}

std::vector<Rigid3> Localizer::Impl::Predict(std::int64_t now_ns, const LocalFrame& local) const {
  std::vector<Rigid3> predictions;
  for (const Rigid3& map_from_cam : history.Predictions(now_ns))
    predictions.push_back(CamFromLocal(map_from_cam, local));
  return predictions;
}

// Around the last fix.
LocalFrame Localizer::Impl::LocalOfSeeds() const {
  const MapView& view = bundle->views()[history.seeds().front()];
  return LocalFrame::At(bundle->panoramas()[view.panorama_idx]);
}

bool Localizer::Impl::CanTrack() const {
  return levers.tracking && pose_options.use_guided && !levers.exhaustive &&
         !history.seeds().empty();
}

PoseOutcome Localizer::Impl::Follow(const FrameFeatures& features, Detail detail,
                                    const LocalFrame& local, FrameResult* result) {
  Stopwatch watch;
  PoseOutcome outcome =
      TrackPose(Context(features, local, detail), Predict(result->timestamp_ns, local));
  result->latency.pose_ms += watch.Lap();
  return outcome;
}

bool Localizer::Impl::TrackCoarse(const GrayImage& image, FrameResult* result) {
  // Rivals are compared on all that a frame shows.
  if (!levers.coarse || !CanTrack() || !history.HasRecentFix() || rivals.IsDue() ||
      rivals.IsAmbiguous()) {
    return false;
  }
  if (coarse_pause > 0) {
    --coarse_pause;
    return false;
  }
  const FrameFeatures features = ExtractFeatures(image, Detail::kCoarse, &result->latency);
  const LocalFrame local = LocalOfSeeds();
  const PoseOutcome outcome = Follow(features, Detail::kCoarse, local, result);
  if (IsSure(outcome, pose_options)) {
    next_coarse_pause = kShortPause;
    return Accept(features, outcome, local, result);
  }
  coarse_pause = next_coarse_pause;
  next_coarse_pause = std::min(kLongPause, 2 * next_coarse_pause);
  return false;
}

// Follows the last fixes: no retrieval, no words.
bool Localizer::Impl::Track(const FrameFeatures& features, FrameResult* result) {
  if (!CanTrack()) return false;
  const LocalFrame local = LocalOfSeeds();
  const PoseOutcome outcome = Follow(features, Detail::kFull, local, result);
  if (!outcome.trusted || outcome.degraded) return false;
  if (outcome.num_inliers < pose_options.weak_inliers &&
      IsDistinct(features, outcome, local, result) && Bridge(features, Bridging::kSure, result)) {
    return true;
  }
  return Accept(features, outcome, local, result);
}

bool Localizer::Impl::Bridge(const FrameFeatures& features, Bridging bridging,
                             FrameResult* result) {
  if (!levers.bridging || !CanTrack() || !history.HasRecentFix() || rivals.IsAmbiguous()) {
    return false;
  }
  Stopwatch watch;
  const LocalFrame local = LocalOfSeeds();
  const PoseOutcome outcome =
      BridgePose(Context(features, local), recent.Triangulate(camera, local, pose_options.guided),
                 Predict(result->timestamp_ns, local));
  result->latency.pose_ms += watch.Lap();
  if (!outcome.trusted || (bridging == Bridging::kSure && outcome.degraded)) return false;
  rivals.Pass();
  result->num_inliers = outcome.num_inliers;
  result->num_views = 0;  // no view vouches for it
  result->reason = outcome.reason;
  Fill(outcome, local, result);
  const auto nearest = stations.Near(result->pose->position_in_map, pose_options.max_distance_m, 1);
  if (!nearest.empty())
    result->best_panorama = bundle->panoramas()[bundle->stations()[nearest[0]].panorama_idx].id;
  Remember(features, outcome, true, result);
  DegradeMiscalibrated(result);
  return true;
}

PoseContext Localizer::Impl::Context(const FrameFeatures& features, const LocalFrame& local,
                                     Detail detail) const {
  const PoseOptions& how = detail == Detail::kCoarse ? coarse_options : pose_options;
  PoseContext context{features, camera, *bundle, stations, local, how, nullptr};
  // Only a fix speaks for a place; likeness alone would speak for a look-alike too.
  if (levers.tracking && history.HasRecentFix() && last_is_distinct) {
    context.prior = [this](const Eigen::Vector3d& position_in_map) {
      return places.BeliefNear(position_in_map, kPriorRadius_m);
    };
    context.past = past.InLocal(*bundle, local);
  }
  return context;
}

std::vector<std::uint32_t> Localizer::Impl::Window() const {
  if (levers.exhaustive) return {};
  std::vector<std::uint32_t> window = places.Likely(kWindowShare, kWindowPanoramas);
  double belief = 0;
  for (const std::uint32_t p : window) belief += places.belief()[p];
  if (belief < kWindowBelief) window.clear();
  return window;
}

RetrievalResult Localizer::Impl::Retrieve(const RetrievalQuery& query,
                                          const std::vector<std::uint32_t>& window,
                                          FrameResult* result) {
  Stopwatch watch;
  RetrievalResult retrieved;
  if (!window.empty()) {
    retrieved = retrieval.Windowed(query, history.seeds(), window);
  } else {
    std::vector<float> similarity;
    retrieved = retrieval.Global(query, &similarity);
    if (!similarity.empty()) places.UpdateSimilarity(similarity);
    votes = std::move(retrieved.votes);
  }
  result->latency.retrieval_ms += watch.Lap();
  // Distinct views: a window lies within the whole map.
  result->num_compared = std::max(result->num_compared, retrieved.num_compared);
  return retrieved;
}

PoseOutcome Localizer::Impl::Solve(const FrameFeatures& features, const RetrievalResult& retrieved,
                                   LocalFrame* local, StageLatency* latency) const {
  Stopwatch watch;
  std::vector<ViewMatches> matches(retrieved.views.size());
  *local = LocalFrame::At(
      bundle->panoramas()[bundle->views()[retrieved.views.front().view_idx].panorama_idx]);
  const MatchOptions match_options;
  tbb::parallel_for(std::size_t{0}, matches.size(), [&](std::size_t i) {
    matches[i] =
        MatchView(features, camera, *bundle, retrieved.views[i].view_idx, *local, match_options);
  });
  latency->matching_ms += watch.Lap();
  constexpr std::size_t kLastFinds = 2;
  PoseContext context = Context(features, *local);
  for (const Rigid3& find : finds.Before(last_frame_ns, kLastFinds))
    context.last_finds.push_back(CamFromLocal(find, *local));
  PoseOutcome outcome = EstimatePose(context, matches);
  latency->pose_ms += watch.Lap();
  return outcome;
}

void Localizer::Impl::Fill(const PoseOutcome& outcome, const LocalFrame& local,
                           FrameResult* result) const {
  const Rigid3 local_from_cam = outcome.cam_from_local.Inverse();
  FramePose pose;
  pose.position_in_map = local.ToMap(local_from_cam.translation);
  pose.map_from_cam = local_from_cam.rotation;
  pose.position = bundle->frame().ToGeodetic(pose.position_in_map);
  const Eigen::Matrix3d enu_from_map = bundle->frame().MapFromEnu(pose.position).transpose();
  pose.enu_from_cam =
      Eigen::Quaterniond(enu_from_map * local_from_cam.rotation.toRotationMatrix()).normalized();
  pose.attitude = AttitudeFromEnu(pose.enu_from_cam.toRotationMatrix() * BodyFromCam().transpose());
  pose.covariance_in_map = outcome.covariance;
  result->pose = pose;
  result->status = outcome.degraded ? FixStatus::kDegraded : FixStatus::kFix;
}

std::vector<Rigid3> Localizer::Impl::PlacesElsewhere(const FrameFeatures& features,
                                                     const Rigid3& cam_from_local,
                                                     const LocalFrame& local) const {
  std::vector<float> own_votes;
  if (votes.empty()) own_votes = retrieval.Votes(features.sift, features.bearings, camera);
  const std::vector<float>& counted = votes.empty() ? own_votes : votes;
  std::vector<std::pair<float, std::uint32_t>> elsewhere;
  std::vector<Rigid3> poses;
  const auto is_near = [&](const Rigid3& a, const Rigid3& b) {
    return (CentreOf(a) - CentreOf(b)).norm() < pose_options.rival_place_m &&
           AngleBetween(a.rotation, b.rotation) < pose_options.elsewhere_rad;
  };
  float own = 0;
  for (std::uint32_t v = 0; v < counted.size(); ++v) {
    if (!(counted[v] > 0)) continue;
    if (is_near(PoseOfView(*bundle, local, v), cam_from_local)) {
      own = std::max(own, counted[v]);
    } else {
      elsewhere.emplace_back(-counted[v], v);
    }
  }
  std::sort(elsewhere.begin(), elsewhere.end());
  for (const auto& [negative_votes, v] : elsewhere) {
    if (-negative_votes < kRivalVotes * own ||
        static_cast<int>(poses.size()) == pose_options.max_rivals) {
      break;
    }
    const Rigid3 pose = PoseOfView(*bundle, local, v);
    const bool is_known = std::any_of(poses.begin(), poses.end(),
                                      [&](const Rigid3& other) { return is_near(pose, other); });
    if (!is_known) poses.push_back(pose);
  }
  return poses;
}

bool Localizer::Impl::IsDistinct(const FrameFeatures& features, const PoseOutcome& outcome,
                                 const LocalFrame& local, FrameResult* result) {
  if (!rivals.IsDue()) {
    rivals.Pass();
    return !rivals.IsAmbiguous();
  }
  Stopwatch watch;
  const std::vector<Rigid3> places_elsewhere =
      PlacesElsewhere(features, outcome.cam_from_local, local);
  result->latency.retrieval_ms += watch.Lap();
  result->num_compared = result->num_database;
  const double elsewhere = SupportElsewhere(Context(features, local), outcome, places_elsewhere);
  result->latency.pose_ms += watch.Lap();
  rivals.Add(outcome.support, std::max(elsewhere, outcome.rival_support));
  LogDebug(
      Format("rival %.3f of %.3f, of the run %.2f", elsewhere, outcome.support, rivals.Share()));
  return !rivals.IsAmbiguous();
}

void Localizer::Impl::Remember(const FrameFeatures& features, const PoseOutcome& outcome,
                               bool is_distinct, const FrameResult* result) {
  const Rigid3 map_from_cam(result->pose->map_from_cam, result->pose->position_in_map);
  history.Add(result->timestamp_ns, map_from_cam, outcome.views, outcome.degraded);
  last_is_distinct = is_distinct;
  if (!is_distinct) return;  // it may be followed, not built upon
  // A weak pose that nothing has confirmed is no ground for a bridge: its error would travel on.
  if (levers.bridging && !outcome.degraded && outcome.num_inliers >= pose_options.weak_inliers)
    recent.Add(result->timestamp_ns, map_from_cam, outcome, features);
  places.UpdateFix(map_from_cam.translation, PositionSigma_m(outcome));
}

void Localizer::Impl::Confirm(const LocalFrame& local, std::int64_t now_ns, PoseOutcome* outcome) {
  if (!levers.confirm || !outcome->unconfirmed) return;
  const Rigid3 local_from_cam = outcome->cam_from_local.Inverse();
  finds.Add(now_ns, {local_from_cam.rotation, local.ToMap(local_from_cam.translation)},
            outcome->num_firm >= pose_options.min_firm);
  if (!finds.IsConfirmed()) return;
  outcome->trusted = true;
  outcome->unconfirmed = false;
  outcome->reason.clear();
  DegradeDoubtful(pose_options, outcome);
}

bool Localizer::Impl::Accept(const FrameFeatures& features, const PoseOutcome& outcome,
                             const LocalFrame& local, FrameResult* result) {
  result->reason = outcome.reason;
  result->num_inliers = outcome.num_inliers;
  result->num_views = static_cast<int>(outcome.views.size());
  // Of a place that was ambiguous before its rivals were searched nothing is known.
  if (!outcome.trusted && (outcome.unconfirmed || outcome.rival_support > 0))
    rivals.Add(outcome.support, outcome.rival_support);
  if (!outcome.trusted) return false;
  // What the map has twice tells no place, however well it is matched; it may be followed, not
  // told.
  const bool is_distinct = !levers.tracking || IsDistinct(features, outcome, local, result);
  Fill(outcome, local, result);
  result->best_panorama = bundle->panoramas()[bundle->views()[outcome.best_view].panorama_idx].id;
  Remember(features, outcome, is_distinct, result);
  if (!is_distinct) {
    result->status = FixStatus::kNoFix;
    result->reason = kAmbiguousPlace;
    result->pose.reset();
    return true;
  }
  if (options.with_sight) {
    result->sight = std::make_shared<const FrameSight>(SightOf(outcome, local, *bundle, camera));
  }
  if (!outcome.degraded) {
    calibration.Add(outcome.focal);
    past.Add(result->timestamp_ns,
             Rigid3(result->pose->map_from_cam, result->pose->position_in_map), outcome.agreed,
             pose_options.past_frames);
  }
  DegradeMiscalibrated(result);
  return true;
}

void Localizer::Impl::DegradeMiscalibrated(FrameResult* result) const {
  if (!levers.guided || result->status != FixStatus::kFix || !calibration.IsOff()) return;
  result->status = FixStatus::kDegraded;
  result->reason = "calibration_off";
  result->pose->covariance_in_map *=
      pose_options.degraded_sigma_factor * pose_options.degraded_sigma_factor;
}

void Localizer::Impl::FollowTiles(const FrameResult& result) {
  constexpr double kMostAhead_m = 200;  // a tile's side
  constexpr double kFramesAhead = 50;   // some seconds
  if (result.pose) {
    const Eigen::Vector3d here = result.pose->position_in_map;
    Eigen::Vector3d way = kFramesAhead * (here - last_in_map.value_or(here));
    if (way.norm() > kMostAhead_m) way *= kMostAhead_m / way.norm();
    if (is_first_of_map) retrieval.Follow(here, here + way);
    last_in_map = here;
  }
  retrieval.Trim();
}

void Localizer::Impl::Advance(std::int64_t now_ns) {
  history.Advance(now_ns);
  if (has_last_frame && now_ns <= last_frame_ns) rivals = RivalWatch();
  rivals.Advance();
  finds.Advance(now_ns);
  recent.Advance(now_ns);
  past.Advance(now_ns, pose_options.past_age_s);
  if (has_last_frame)
    places.Predict(1e-9 * (static_cast<double>(now_ns) - static_cast<double>(last_frame_ns)));
  last_frame_ns = now_ns;
  has_last_frame = true;
}

}  // namespace panofix
