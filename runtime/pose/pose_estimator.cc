#include "runtime/pose/pose_estimator.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <optional>
#include <stdexcept>
#include <tuple>

#include "common/base/log.h"
#include "runtime/pose/candidate.h"
#include "runtime/pose/gates.h"
#include "runtime/pose/make_in_order.h"

namespace panofix {
namespace {

constexpr double kAnyTurn_rad = 4;

struct Hypothesis {
  Rigid3 cam_from_local;
  int num_keypoints = 0;  // that agree among the matches it comes from
};

// A pose a view that reaches consensus, and one of all views together.
std::vector<Hypothesis> FindHypotheses(const std::vector<ViewMatches>& views, const MatchPool& pool,
                                       double focal_px, const PoseOptions& options) {
  std::vector<std::optional<Hypothesis>> found(views.size() + 1);
  tbb::parallel_for(std::size_t{0}, found.size(), [&](std::size_t i) {
    const RansacResult result = i == views.size()
                                    ? FindConsensus(pool, options)
                                    : EstimatePoseRansac(views[i].correspondences, options.ransac);
    if (!result.success || static_cast<int>(result.inliers.size()) < options.min_view_inliers) {
      return;
    }
    found[i] = Hypothesis{result.cam_from_map, CountKeypoints(pool, result.cam_from_map, focal_px)};
  });
  std::vector<Hypothesis> hypotheses;
  for (const auto& hypothesis : found) {
    if (hypothesis) hypotheses.push_back(*hypothesis);
  }
  return hypotheses;
}

// Whether a pose is one of `poses`, near enough.
bool IsRepeat(const Rigid3& pose, const std::vector<Rigid3>& poses, double distance_m,
              double turn_rad) {
  return std::any_of(poses.begin(), poses.end(), [&](const Rigid3& other) {
    return (CentreOf(other) - CentreOf(pose)).norm() < distance_m &&
           AngleBetween(other.rotation, pose.rotation) < turn_rad;
  });
}

// A pose that nothing foretold needs more evidence than one that was.
bool IsSureFind(const PoseOutcome& outcome, const PoseOptions& options) {
  if (std::min(outcome.num_firm, outcome.num_inliers) >= options.find_firm) return true;
  return outcome.num_near_inliers >= options.find_inliers &&
         outcome.support >= options.find_support &&
         (outcome.over_chance >= options.find_over_chance || HasPlenty(outcome, options)) &&
         outcome.coverage >= options.find_coverage;
}

// Most keypoints first, near repeats left out.
std::vector<Hypothesis> DistinctBest(std::vector<Hypothesis> hypotheses, std::size_t most) {
  constexpr double kSamePlace_m = 0.7, kSameTurn_rad = 0.05;
  std::stable_sort(
      hypotheses.begin(), hypotheses.end(),
      [](const Hypothesis& a, const Hypothesis& b) { return a.num_keypoints > b.num_keypoints; });
  std::vector<Hypothesis> distinct;
  std::vector<Rigid3> poses;
  for (const Hypothesis& h : hypotheses) {
    if (IsRepeat(h.cam_from_local, poses, kSamePlace_m, kSameTurn_rad)) continue;
    distinct.push_back(h);
    poses.push_back(h.cam_from_local);
    if (distinct.size() == most) break;
  }
  return distinct;
}

// How many hypotheses are worth a guided search: one where it is sure.
std::size_t NumWorthy(const std::vector<Hypothesis>& hypotheses, const PoseOptions& options) {
  const bool is_sure = std::any_of(hypotheses.begin(), hypotheses.end(), [&](const Hypothesis& h) {
    return h.num_keypoints >= options.sure_inliers;
  });
  return is_sure || !options.use_guided ? 1 : static_cast<std::size_t>(options.max_candidates);
}

// Candidates of one frame, gated as they come.
class Candidates {
 public:
  // `hypotheses` of the frame, of which those elsewhere count against a candidate.
  Candidates(const PoseContext& context, std::vector<Hypothesis> hypotheses, std::string reason)
      : context_(context),
        hypotheses_(std::move(hypotheses)),
        grid_(context.frame.sift, context.camera),
        scene_{context.frame,    grid_,         context.camera, context.bundle,
               context.stations, context.local, context.past} {
    best_.reason = std::move(reason);
  }
  [[nodiscard]] const Scene& scene() const { return scene_; }
  [[nodiscard]] PoseOutcome& best() { return best_; }
  [[nodiscard]] const std::vector<PoseOutcome>& all() const { return all_; }
  [[nodiscard]] const std::vector<Hypothesis>& hypotheses() const { return hypotheses_; }

  // Candidates in order, as long as one is wanted.
  template <typename IsWanted, typename Make>
  void ConsiderEach(std::size_t count, const IsWanted& is_wanted, const Make& make,
                    Reach reach = Reach::kNear) {
    MakeInOrder<PoseOutcome>(count, is_wanted, make,
                             [&](PoseOutcome outcome) { Consider(std::move(outcome), reach); });
  }
  template <typename Make>
  void ConsiderAll(std::size_t count, const Make& make, Reach reach = Reach::kNear) {
    ConsiderEach(
        count, [] { return true; }, make, reach);
  }

  // A wide one is better than all near ones: it rests on more.
  void Consider(PoseOutcome outcome, Reach reach = Reach::kNear) {
    if (!outcome.found) return;
    for (const Hypothesis& h : hypotheses_) {
      if (IsElsewhere(h.cam_from_local, outcome.cam_from_local) &&
          IsOpen(h.cam_from_local, outcome.cam_from_local))
        outcome.num_elsewhere = std::max(outcome.num_elsewhere, h.num_keypoints);
    }
    outcome.station_distance_m =
        StationDistance_m(context_.stations, context_.local, outcome.cam_from_local);
    outcome.reason = FailedGate(outcome, context_.bundle, context_.local, context_.options);
    outcome.trusted = outcome.reason.empty();
    LogCandidate(outcome, context_.bundle, context_.local);
    if (Worth(outcome, reach) > Worth(best_, reach_of_best_)) {
      best_ = outcome;
      reach_of_best_ = reach;
    }
    all_.push_back(std::move(outcome));
  }

  // Whether the past leaves it open that the vehicle is at `other` rather than at `pose`.
  [[nodiscard]] bool IsOpen(const Rigid3& other, const Rigid3& pose) const {
    if (!context_.prior) return true;
    const auto belief = [&](const Rigid3& at) {
      return context_.prior(context_.local.ToMap(CentreOf(at)));
    };
    return belief(other) > context_.options.min_prior_share * belief(pose);
  }

  [[nodiscard]] bool IsElsewhere(const Rigid3& pose, const Rigid3& from) const {
    return (CentreOf(pose) - CentreOf(from)).norm() > context_.options.elsewhere_m ||
           AngleBetween(pose.rotation, from.rotation) > context_.options.elsewhere_rad;
  }

  // Of a few landmarks even a large share is no rival; nor is what would be no sure find itself and
  // is a cluster, or has but a part of the pose's firm matches. A rival is made of near landmarks:
  // of a pose made of wide ones the near part is compared.
  [[nodiscard]] bool IsRival(const PoseOutcome& other, const PoseOutcome& own) const {
    const PoseOptions& options = context_.options;
    if (other.num_inliers < options.min_inliers ||
        !IsElsewhere(other.cam_from_local, own.cam_from_local)) {
      return false;
    }
    if (other.num_inliers >= options.find_inliers) return true;
    const double own_firm =
        double(own.num_firm) * own.num_near_inliers / std::max(1, own.num_inliers);
    const bool is_part = own_firm >= options.min_firm / 2.0 &&
                         other.num_firm < options.min_rival_firm_share * own_firm;
    return !is_part && other.spread >= options.min_spread;
  }

  // The pose with most inliers so far, where they make a hypothesis.
  [[nodiscard]] std::optional<Rigid3> Start() const {
    const auto most = std::max_element(
        all_.begin(), all_.end(),
        [](const PoseOutcome& a, const PoseOutcome& b) { return a.num_inliers < b.num_inliers; });
    if (most == all_.end() || most->num_inliers < context_.options.min_view_inliers) return {};
    return most->cam_from_local;
  }

 private:
  // Near ones are told by their support, wide ones by their firm matches.
  static std::tuple<bool, bool, double, int> Worth(const PoseOutcome& outcome, Reach reach) {
    const bool is_wide = reach == Reach::kWide;
    return {outcome.trusted, is_wide, is_wide ? outcome.num_firm : outcome.support,
            outcome.num_inliers};
  }

  const PoseContext& context_;
  const std::vector<Hypothesis> hypotheses_;
  const KeypointGrid grid_;
  const Scene scene_;
  PoseOutcome best_;
  Reach reach_of_best_ = Reach::kNear;
  std::vector<PoseOutcome> all_;
};

// Looks for landmarks around a rough pose; a consensus among them becomes a candidate.
PoseOutcome PoseAround(const Scene& scene, const Rigid3& rough, double radius_px,
                       const PoseOptions& options, Reach reach = Reach::kNear) {
  const MatchPool pool = MatchNear(scene, rough, radius_px, options, reach);
  const RansacResult found = FindConsensus(pool, options);
  if (!found.success) return {};
  return CompletePose(scene, found.cam_from_map, pool, options, reach);
}

// The same around a retrieved view's own pose, a rough one of the camera. More stations agree on
// where to look; what speaks for the pose is counted among the nearest, as ever.
PoseOutcome PoseAtView(const Scene& scene, const Rigid3& rough, const PoseOptions& options) {
  const MatchPool wide = MatchNear(scene, rough, options.around_view_px, options,
                                   options.use_wide ? Reach::kWide : Reach::kNear);
  const RansacResult found =
      FindConsensus(wide, options, BoundsAround(rough, options.around_view_m, options));
  if (!found.success) return {};
  return CompletePose(scene, found.cam_from_map,
                      MatchNear(scene, found.cam_from_map, options.around_px, options), options);
}

// How far poses must be from each other not to start the same search.
struct Apart {
  double distance_m, turn_rad;
};

// Poses of the retrieved views, rough ones of the camera: at most `most` that are no repeats of
// each other nor of `known`.
std::vector<Rigid3> RoughPoses(const PoseContext& context, const std::vector<ViewMatches>& views,
                               int most, const Apart& apart,
                               const std::vector<Rigid3>& known = {}) {
  std::vector<Rigid3> poses;
  for (const ViewMatches& view : views) {
    if (static_cast<int>(poses.size()) == most) break;
    const Rigid3 rough = PoseOfView(context.bundle, context.local, view.view_idx);
    const auto is_repeat = [&](const std::vector<Rigid3>& of) {
      return IsRepeat(rough, of, apart.distance_m, apart.turn_rad);
    };
    if (!is_repeat(known) && !is_repeat(poses)) poses.push_back(rough);
  }
  return poses;
}

// Look-alikes: what would the landmarks of the other places say?
void RefuseLookAlike(const PoseContext& context, const std::vector<ViewMatches>& views,
                     const MatchPool& pool, Candidates* candidates) {
  const PoseOptions& options = context.options;
  std::vector<Rigid3> unknown;
  const std::vector<Hypothesis>& hypotheses = candidates->hypotheses();
  for (const Hypothesis& h : DistinctBest(hypotheses, hypotheses.size())) {
    const auto is_near = [&](const Rigid3& pose) {
      return !candidates->IsElsewhere(h.cam_from_local, pose);
    };
    if (static_cast<int>(unknown.size()) == options.max_rivals) break;
    if (std::none_of(unknown.begin(), unknown.end(), is_near) &&
        std::none_of(candidates->all().begin(), candidates->all().end(),
                     [&](const PoseOutcome& c) { return is_near(c.cam_from_local); })) {
      unknown.push_back(h.cam_from_local);
    }
  }
  // Retrieval knows of places that no consensus has led to.
  const std::vector<Rigid3> places =
      RoughPoses(context, views, options.max_rivals, {options.rival_place_m, kAnyTurn_rad},
                 {candidates->best().cam_from_local});
  const Scene& scene = candidates->scene();
  candidates->ConsiderAll(unknown.size() + places.size(), [&](std::size_t i) {
    return i < unknown.size()
               ? CompletePose(scene, unknown[i], pool, options)
               : PoseAround(scene, places[i - unknown.size()], options.around_view_px, options);
  });
  PoseOutcome& best = candidates->best();
  for (const PoseOutcome& c : candidates->all()) {
    if (candidates->IsRival(c, best) && candidates->IsOpen(c.cam_from_local, best.cam_from_local))
      best.rival_support = std::max(best.rival_support, c.support);
  }
  if (best.rival_support > options.max_rival_share * best.support) {
    best.trusted = false;
    best.reason = kAmbiguousPlace;
  }
}

}  // namespace

void PoseOptions::Check() const {
  ransac.Check();
  if (min_view_inliers < 4) {
    throw std::invalid_argument(
        Format("min_view_inliers = %d; must be at least 4", min_view_inliers));
  }
  if (min_inliers < 6)
    throw std::invalid_argument(Format("min_inliers = %d; must be at least 6", min_inliers));
}

PoseOutcome EstimatePose(const PoseContext& context, const std::vector<ViewMatches>& views) {
  const PoseOptions& options = context.options;
  MatchPool pool;
  for (const ViewMatches& view : views) {
    pool.Append(view);
    const MapView& v = context.bundle.views()[view.view_idx];
    LogDebug(Format("retrieved %s station %u yaw %g: %zu matches",
                    context.bundle.panoramas()[v.panorama_idx].id.c_str(),
                    v.station_idx - context.bundle.first_station(v.panorama_idx), v.yaw_deg,
                    view.correspondences.size()));
  }
  constexpr std::size_t kFewestMatches = 12;
  Candidates candidates(context, FindHypotheses(views, pool, context.camera.fx_px, options),
                        pool.matches.size() < kFewestMatches ? "too_few_matches" : "no_consensus");
  const Scene& scene = candidates.scene();
  PoseOutcome& best = candidates.best();
  const std::vector<Hypothesis> starts =
      DistinctBest(candidates.hypotheses(), NumWorthy(candidates.hypotheses(), options));
  candidates.ConsiderEach(
      starts.size(), [&] { return !best.trusted || best.over_chance < options.sure_over_chance; },
      [&](std::size_t i) { return CompletePose(scene, starts[i].cam_from_local, pool, options); });
  // A strong pose with a second elsewhere: without a past, more of the map does not tell which.
  const bool repeats =
      !context.prior && best.reason == kAmbiguousPlace && best.num_inliers >= options.find_inliers;
  if (options.use_guided && !repeats) {
    constexpr Apart kNextView{3.5, 0.5};  // neighbouring stations, in one direction
    const std::vector<Rigid3> roughs =
        RoughPoses(context, views, options.max_view_poses, kNextView);
    candidates.ConsiderEach(
        roughs.size(), [&] { return !best.trusted; },
        [&](std::size_t i) { return PoseAtView(scene, roughs[i], options); });
  }
  const bool is_doubtful = !repeats && (!best.trusted || !IsSureFind(best, options));
  if (options.use_guided && options.use_wide && is_doubtful) {
    std::vector<std::pair<Rigid3, double>> around;  // cam_from_local, radius in pixels
    if (const auto start = candidates.Start()) around.emplace_back(*start, options.around_px / 2);
    for (const Rigid3& find : context.last_finds) around.emplace_back(find, options.around_px);
    candidates.ConsiderAll(
        around.size(),
        [&](std::size_t i) {
          return PoseAround(scene, around[i].first, around[i].second, options, Reach::kWide);
        },
        Reach::kWide);
  }
  if (best.trusted && options.use_guided) RefuseLookAlike(context, views, pool, &candidates);
  if (best.trusted && options.use_guided && !IsSureFind(best, options)) {
    best.trusted = false;
    best.unconfirmed = true;
    best.reason = "unconfirmed";
  }
  if (best.trusted) DegradeDoubtful(options, &best);
  return best;
}

PoseOutcome TrackPose(const PoseContext& context, const std::vector<Rigid3>& predictions) {
  const PoseOptions& options = context.options;
  Candidates candidates(context, {}, "no_consensus");
  PoseOutcome& best = candidates.best();
  const auto refuse_jump = [&](const Rigid3& prediction) {
    const double shift_m = (CentreOf(best.cam_from_local) - CentreOf(prediction)).norm();
    if (!best.trusted || shift_m < options.max_track_shift_m) return;
    best.trusted = false;
    best.reason = "jump";
  };
  std::size_t used = 0;
  for (std::size_t i = 0; i < predictions.size() && !best.trusted; ++i) {
    candidates.Consider(PoseAround(candidates.scene(), predictions[i], options.around_px, options));
    refuse_jump(predictions[i]);
    if (best.trusted) used = i;
  }
  if (options.use_wide && !predictions.empty() && best.num_inliers < options.weak_inliers) {
    const PoseOutcome near = best;
    // From the prediction anew: a biased pose would hold on to what suits it.
    candidates.Consider(
        PoseAround(candidates.scene(), predictions[used], options.around_px, options, Reach::kWide),
        Reach::kWide);
    refuse_jump(predictions[used]);
    if (near.trusted && !best.trusted) best = near;
  }
  if (best.trusted) DegradeDoubtful(options, &best);
  return best;
}

double SupportElsewhere(const PoseContext& context, const PoseOutcome& own,
                        const std::vector<Rigid3>& roughs) {
  Candidates candidates(context, {}, "no_consensus");
  candidates.ConsiderAll(roughs.size(), [&](std::size_t i) {
    return PoseAround(candidates.scene(), roughs[i], context.options.around_view_px,
                      context.options);
  });
  double support = 0;
  for (const PoseOutcome& c : candidates.all()) {
    if (candidates.IsRival(c, own)) support = std::max(support, c.support);
  }
  return support;
}

}  // namespace panofix
