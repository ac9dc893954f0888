#include "builder/landmarks/joint_solver.h"

#include <ceres/normal_prior.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>

#include "builder/landmarks/refinement_costs.h"

namespace panofix {
namespace {

constexpr int kFewestOnPlane = 3;  // tracks; fewer cannot show what they share
constexpr double kLeastSigma = 1e-6;
constexpr double kPlaneLoss = 2;  // sigmas from which a point counts as off its plane
constexpr double kCauchy = 2, kTukey = 4.6851;
constexpr std::array<int, 3> kIterations = {15, 10, 10};
// Tracks share their errors (a stitch, a relief, a texture seen in one light): against the geotags
// all those of a panorama count as this many. Without it, long rows of panoramas bend by
// decimetres.
constexpr double kEffectiveTracks = 25;

SightLine LineOf(const LayerInput& input, const MergedLandmarks& merged, LandmarkRef anchor,
                 std::uint32_t observer) {
  return {input.panoramas[anchor.panorama].local_from_pano,
          input.panoramas[observer].local_from_pano,
          Get(merged, anchor).point_in_pano.cast<double>()};
}

Eigen::Vector3d RayOf(const Landmark& landmark) {
  return landmark.point_in_pano.cast<double>().normalized();
}

double BearingSigma_rad(const Landmark& anchor, const Landmark& other) {
  return std::hypot(double{anchor.point_sigma_m}, double{other.point_sigma_m}) /
         double{other.point_in_pano.norm()};
}

SurfaceRef SurfaceOf(const MergedLandmarks& merged, LandmarkRef ref) {
  return {ref.panorama, Get(merged, ref).surface_idx};
}

// Planes become variables where enough tracks see them.
void AddPlanes(const LayerInput& input, const MergedLandmarks& merged, JointState* state) {
  std::map<SurfaceRef, int> count;
  for (const JointTrack& track : state->tracks) {
    ++count[SurfaceOf(merged, track.anchor)];
    for (const LandmarkRef other : track.others) ++count[SurfaceOf(merged, other)];
  }
  for (const auto& [surface, n] : count) {
    const bool is_plane =
        PlaneModel::Of(input.panoramas[surface.first], surface.second).has_value();
    if (n >= kFewestOnPlane && is_plane)
      state->planes.try_emplace(surface, Eigen::Vector3d::Zero());
  }
}

ceres::CostFunction* PriorAt(const Eigen::VectorXd& mean, const Eigen::VectorXd& sigmas) {
  const Eigen::VectorXd inverse = sigmas.cwiseMax(kLeastSigma).cwiseInverse();
  return new ceres::NormalPrior(inverse.asDiagonal(), mean);
}

// A track's loss at the weight that tracks have. Takes the loss.
std::unique_ptr<ceres::LossFunction> Shared(ceres::LossFunction* loss, double share) {
  return std::make_unique<ceres::ScaledLoss>(loss, share, ceres::TAKE_OWNERSHIP);
}

// That weight: tracks of a panorama, on average, against those they count as.
double TrackShare(const LayerInput& input, const JointState& state) {
  std::size_t num_members = 0;
  for (const JointTrack& track : state.tracks) num_members += track.others.size() + 1;
  const double mean =
      static_cast<double>(num_members) / static_cast<double>(input.panoramas.size());
  return std::min(1.0, kEffectiveTracks / mean);
}

// One pass with the loss given.
class Pass {
 public:
  Pass(const LayerInput& input, const MergedLandmarks& merged, double share,
       ceres::LossFunction* bearing_loss, JointState* state)
      : input_(input),
        merged_(merged),
        state_(state),
        bearing_loss_(bearing_loss),
        plane_loss_(Shared(new ceres::CauchyLoss(kPlaneLoss), share)) {
    ceres::Problem::Options options;
    options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    problem_ = std::make_unique<ceres::Problem>(options);
    ordering_ = std::make_shared<ceres::ParameterBlockOrdering>();
    Load();
    for (std::size_t t = 0; t < state_->tracks.size(); ++t) AddTrack(t);
    AddPriors();
  }

  void Solve(int max_iterations) {
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::SPARSE_SCHUR;
    options.linear_solver_ordering = ordering_;
    options.num_threads = 1;
    options.max_num_iterations = max_iterations;
    options.function_tolerance = 1e-7;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, problem_.get(), &summary);
    if (summary.IsSolutionUsable()) Store();
  }

 private:
  // All variables in one piece of memory: Ceres orders blocks by address.
  void Load() {
    for (const Vector6d& correction : state_->corrections) {
      values_.insert(values_.end(), correction.data(), correction.data() + 6);
    }
    for (const auto& [surface, delta] : state_->planes) {
      plane_at_[surface] = values_.size();
      values_.insert(values_.end(), delta.data(), delta.data() + 3);
    }
    first_range_ = values_.size();
    for (const JointTrack& track : state_->tracks) values_.push_back(track.range);
  }
  void Store() {
    for (std::uint32_t p = 0; p < state_->corrections.size(); ++p) {
      state_->corrections[p] = Eigen::Map<const Vector6d>(Pose(p));
    }
    for (auto& [surface, delta] : state_->planes) {
      delta = Eigen::Map<const Eigen::Vector3d>(&values_[plane_at_.at(surface)]);
    }
    for (std::size_t t = 0; t < state_->tracks.size(); ++t) state_->tracks[t].range = *Range(t);
  }
  double* Pose(std::uint32_t panorama) { return &values_[6 * std::size_t{panorama}]; }
  double* Range(std::size_t track) { return &values_[first_range_ + track]; }
  // The plane's block, or null where it is no variable.
  double* Plane(LandmarkRef ref) {
    const auto entry = plane_at_.find(SurfaceOf(merged_, ref));
    return entry == plane_at_.end() ? nullptr : &values_[entry->second];
  }
  const PlaneModel* Model(LandmarkRef ref, std::optional<PlaneModel>* storage) {
    if (Plane(ref) == nullptr) return nullptr;
    *storage = PlaneModel::Of(input_.panoramas[ref.panorama], Get(merged_, ref).surface_idx);
    return &**storage;
  }

  void AddTrack(std::size_t index) {
    const JointTrack& track = state_->tracks[index];
    std::optional<PlaneModel> storage;
    const Landmark& anchor = Get(merged_, track.anchor);
    std::vector<double*> blocks = {Range(index)};
    if (Plane(track.anchor) != nullptr) blocks.push_back(Plane(track.anchor));
    problem_->AddResidualBlock(new AnchorPlaneCost(anchor.point_in_pano.cast<double>(),
                                                   JointDepthPrior(input_, merged_, track,
                                                                   track.anchor, blocks.size() > 1),
                                                   Model(track.anchor, &storage)),
                               plane_loss_.get(), blocks);
    ordering_->AddElementToGroup(Range(index), 0);
    for (const LandmarkRef ref : track.others) {
      const Landmark& other = Get(merged_, ref);
      const SightLine line = LineOf(input_, merged_, track.anchor, ref.panorama);
      blocks = {Pose(track.anchor.panorama), Pose(ref.panorama), Range(index)};
      problem_->AddResidualBlock(
          new BearingCost(line, RayOf(other), BearingSigma_rad(anchor, other)), bearing_loss_,
          blocks);
      if (Plane(ref) != nullptr) blocks.push_back(Plane(ref));
      problem_->AddResidualBlock(
          new OffPlaneCost(line, JointDepthPrior(input_, merged_, track, ref, blocks.size() > 3),
                           Model(ref, &storage)),
          plane_loss_.get(), blocks);
    }
  }

  void AddPriors() {
    const double turn_rad = input_.errors.panorama_heading_sigma_deg * kRadPerDeg;
    Vector6d pose_sigmas = Vector6d::Constant(turn_rad);
    pose_sigmas.head<3>().setConstant(input_.errors.panorama_position_sigma_m);
    for (std::uint32_t p = 0; p < input_.panoramas.size(); ++p) {
      if (!problem_->HasParameterBlock(Pose(p))) continue;
      ordering_->AddElementToGroup(Pose(p), 1);
      if (input_.panoramas[p].is_fixed) {
        problem_->SetParameterBlockConstant(Pose(p));
      } else {
        problem_->AddResidualBlock(PriorAt(Vector6d::Zero(), pose_sigmas), nullptr, Pose(p));
      }
    }
    const PlaneSigmas sigmas = PriorSigmas(input_.errors);
    const Eigen::Vector3d plane_sigmas(sigmas.distance_share, sigmas.normal_rad, sigmas.normal_rad);
    for (const auto& [surface, at] : plane_at_) {
      problem_->AddResidualBlock(PriorAt(Eigen::Vector3d::Zero(), plane_sigmas), nullptr,
                                 &values_[at]);
      ordering_->AddElementToGroup(&values_[at], 1);
    }
  }

  const LayerInput& input_;
  const MergedLandmarks& merged_;
  JointState* state_;
  std::vector<double> values_;
  std::map<SurfaceRef, std::size_t> plane_at_;  // offset in values_
  std::size_t first_range_ = 0;
  ceres::LossFunction* bearing_loss_;
  std::unique_ptr<ceres::LossFunction> plane_loss_;
  std::unique_ptr<ceres::Problem> problem_;
  std::shared_ptr<ceres::ParameterBlockOrdering> ordering_;
};

}  // namespace

JointTrack MakeJointTrack(const MergedLandmarks& merged, const Track& track) {
  const auto range_m = [&](LandmarkRef ref) { return Get(merged, ref).point_in_pano.norm(); };
  const auto nearest =
      std::min_element(track.members.begin(), track.members.end(),
                       [&](LandmarkRef a, LandmarkRef b) { return range_m(a) < range_m(b); });
  JointTrack joint{*nearest, {}, 1};
  for (const LandmarkRef ref : track.members) {
    if (ref != *nearest) joint.others.push_back(ref);
  }
  return joint;
}

DepthPrior JointDepthPrior(const LayerInput& input, const MergedLandmarks& merged,
                           const JointTrack& track, LandmarkRef member, bool plane_is_variable) {
  const Landmark& landmark = Get(merged, member);
  const auto plane = PlaneModel::Of(input.panoramas[member.panorama], landmark.surface_idx);
  DepthPrior prior = DepthPriorOf(landmark, plane, Eigen::Vector3d::Zero(), input.errors);
  if (!plane) return prior;  // a raster errs on its own
  prior.sigma_m *= std::sqrt(static_cast<double>(track.others.size() + 1));
  if (plane_is_variable) return prior;
  const Eigen::Vector3d point = landmark.point_in_pano.cast<double>();
  const double shared_m = SharedRangeSigma_m(point, *plane, PriorSigmas(input.errors));
  prior.sigma_m =
      std::hypot(prior.sigma_m, shared_m * std::abs(plane->normal.dot(point.normalized())));
  return prior;
}

void SolveJointly(const LayerInput& input, const MergedLandmarks& merged, JointState* state) {
  if (state->tracks.empty()) return;
  AddPlanes(input, merged, state);
  const double share = TrackShare(input, *state);
  const std::array<std::unique_ptr<ceres::LossFunction>, 3> losses = {
      Shared(new ceres::CauchyLoss(kCauchy), share),
      Shared(new ceres::TukeyLoss(2 * kTukey), share), Shared(new ceres::TukeyLoss(kTukey), share)};
  for (std::size_t k = 0; k < losses.size(); ++k) {
    Pass(input, merged, share, losses[k].get(), state).Solve(kIterations[k]);
  }
}

BearingError BearingErrorOf(const LayerInput& input, const MergedLandmarks& merged,
                            const JointState& state, const JointTrack& track, LandmarkRef other) {
  const Eigen::Vector3d point =
      LineOf(input, merged, track.anchor, other.panorama)
          .PointInObserver(state.corrections[track.anchor.panorama],
                           state.corrections[other.panorama], track.range, nullptr);
  const double angle_rad = std::atan2(RayOf(Get(merged, other)).cross(point).norm(),
                                      RayOf(Get(merged, other)).dot(point));
  const double sigma_rad = BearingSigma_rad(Get(merged, track.anchor), Get(merged, other));
  return {angle_rad * input.focal_px, angle_rad / sigma_rad};
}

double RangeInformation(const LayerInput& input, const MergedLandmarks& merged,
                        const JointState& state, const JointTrack& track) {
  const double anchor_m = double{Get(merged, track.anchor).point_in_pano.norm()};
  double information = 0;
  for (const LandmarkRef other : track.others) {
    if (BearingErrorOf(input, merged, state, track, other).whitened >= kTukey) continue;
    SightLine::Jacobians by;
    Eigen::Vector2d offset;
    Matrix23d by_point;
    const Eigen::Vector3d point =
        LineOf(input, merged, track.anchor, other.panorama)
            .PointInObserver(state.corrections[track.anchor.panorama],
                             state.corrections[other.panorama], track.range, &by);
    if (!BearingOffset(RayOf(Get(merged, other)), point, &offset, &by_point)) continue;
    const double sigma_rad = BearingSigma_rad(Get(merged, track.anchor), Get(merged, other));
    information += (by_point * by.range / (sigma_rad * anchor_m)).squaredNorm();
  }
  return information;
}

}  // namespace panofix
