#include "common/estimate/bundle_problem.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

namespace panofix {
namespace {

constexpr double kMinPriorSigma = 1e-6;  // a prior of zero is a fixed panorama
constexpr double kUnusable = std::numeric_limits<double>::infinity();
// Keeps a past frame that lost its matches solvable: 1 / (1 km)^2, no news to any other.
constexpr double kLeastInformation = 1e-6;
// A past frame agrees with its matches where half of them lie within this many tukey_t: panoramas
// have not moved yet.
constexpr double kStartFactor = 2;

double Inverse(double sigma) { return 1 / (sigma > kMinPriorSigma ? sigma : kMinPriorSigma); }

Vector6d InverseSigmas(const PanoramaPrior& prior) {
  const double position = Inverse(prior.position_sigma_m), tilt = Inverse(prior.tilt_sigma_rad);
  Vector6d result;
  result << position, position, position, tilt, tilt, Inverse(prior.heading_sigma_rad);
  return result;
}

// Share of a frame's matches that agree with its pose before anything has moved.
bool MostlyAgrees(const BundleFrame& frame, double tukey_t) {
  const CameraFrame camera(frame.cam_from_map);
  std::size_t agree = 0;
  for (const Correspondence& match : frame.matches) {
    BundleLinear linear;
    if (IsFinite(match) &&
        LinearizeBundle(BundleMatch(match), camera, {}, Eigen::Vector3d::Zero(), &linear) &&
        linear.residual.norm() < kStartFactor * tukey_t) {
      ++agree;
    }
  }
  return 2 * agree > frame.matches.size();
}

bool IsUsable(const Rigid3& pose) {
  return pose.translation.allFinite() && pose.rotation.coeffs().allFinite();
}

}  // namespace

struct BundleProblem::Motions {
  std::vector<CameraFrame> frames;
  std::vector<PanoramaMotion> panoramas;
  const BundleState& state;
  const PanoramaMotion still;
  [[nodiscard]] const CameraFrame& Frame(const Entry& e) const {
    return frames[static_cast<std::size_t>(e.frame)];
  }
  [[nodiscard]] const PanoramaMotion& Panorama(const Entry& e) const {
    return e.panorama < 0 ? still : panoramas[static_cast<std::size_t>(e.panorama)];
  }
  [[nodiscard]] Eigen::Vector3d Surface(const Entry& e) const {
    if (e.surface < 0) return Eigen::Vector3d::Zero();
    return state.surface_deltas[static_cast<std::size_t>(e.surface)];
  }
};

BundleProblem::Motions BundleProblem::Prepare(const BundleState& state) const {
  return {{state.cam_from_map.begin(), state.cam_from_map.end()},
          {state.panorama_deltas.begin(), state.panorama_deltas.end()},
          state,
          {}};
}

BundleProblem::BundleProblem(std::span<const BundleFrame> frames,
                             std::span<const PanoramaPrior> priors, const BundleOptions& options) {
  for (const PanoramaPrior& prior : priors) inverse_sigmas_.push_back(InverseSigmas(prior));
  const auto most = static_cast<std::size_t>(std::max(0, options.max_matches_per_past_frame));
  for (std::size_t f = 0; f < frames.size(); ++f) {
    const bool newest = f + 1 == frames.size();
    if (!newest && (!IsUsable(frames[f].cam_from_map) || most == 0 ||
                    !MostlyAgrees(frames[f], options.tukey_t))) {
      continue;
    }
    AddFrame(frames[f], priors, newest ? frames[f].matches.size() : most);
  }
  start_.panorama_deltas.assign(priors.size(), Vector6d::Zero());
  FindSurfaces();
}

void BundleProblem::AddFrame(const BundleFrame& frame, std::span<const PanoramaPrior> priors,
                             std::size_t most) {
  const std::size_t num_used = std::min(most, frame.matches.size());
  for (std::size_t k = 0; k < num_used; ++k) {
    const Correspondence& match = frame.matches[k * frame.matches.size() / num_used];
    if (!IsFinite(match)) continue;
    const auto prior = std::find_if(priors.begin(), priors.end(), [&](const PanoramaPrior& p) {
      return match.panorama_idx >= 0 && p.panorama_idx == match.panorama_idx;
    });
    entries_.push_back({BundleMatch(match), num_frames(),
                        prior == priors.end() ? -1 : static_cast<int>(prior - priors.begin())});
  }
  start_.cam_from_map.push_back(frame.cam_from_map);
}

void BundleProblem::FindSurfaces() {
  constexpr int kFewestOnSurface = 3;  // fewer cannot show what they share
  group_sizes_.assign(inverse_sigmas_.size(), 6);
  std::map<int, int> count, index_of;
  for (const Entry& e : entries_) {
    if (e.match.match.surface_id >= 0 && e.panorama >= 0) ++count[e.match.match.surface_id];
  }
  for (Entry& e : entries_) {
    const Correspondence& match = e.match.match;
    const bool has_shared = match.surface_distance_sigma > 0 || match.surface_normal_sigma_rad > 0;
    if (e.panorama < 0 || match.surface_id < 0 || !has_shared ||
        count[match.surface_id] < kFewestOnSurface) {
      continue;
    }
    const auto [entry, is_new] =
        index_of.try_emplace(match.surface_id, static_cast<int>(surfaces_.size()));
    if (is_new) {
      const double tilt = Inverse(match.surface_normal_sigma_rad);
      int& size = group_sizes_[static_cast<std::size_t>(e.panorama)];
      surfaces_.push_back({e.panorama,
                           std::exchange(size, size + 3),
                           {Inverse(match.surface_distance_sigma), tilt, tilt}});
    }
    // An id belongs to one panorama; where a caller breaks that, the match has no surface.
    if (surfaces_[static_cast<std::size_t>(entry->second)].panorama != e.panorama) continue;
    e.surface = entry->second;
    e.match = BundleMatch(WithoutSharedError(match));
  }
  start_.surface_deltas.assign(surfaces_.size(), Eigen::Vector3d::Zero());
}

BundleSystem BundleProblem::PriorSystem(const BundleState& state) const {
  BundleSystem system;
  const Eigen::Index rows = 6 * num_frames();
  system.frames = kLeastInformation * Eigen::MatrixXd::Identity(rows, rows);
  system.frames.bottomRightCorner<6, 6>().setZero();  // the newest has to stand by itself
  system.frame_gradient = Eigen::VectorXd::Zero(rows);
  for (std::size_t p = 0; p < inverse_sigmas_.size(); ++p) {
    const Eigen::Index n = group_sizes_[p];
    BundleGroup group{Eigen::MatrixXd::Zero(n, n), Eigen::MatrixXd::Zero(rows, n),
                      Eigen::VectorXd::Zero(n)};
    const Vector6d information = inverse_sigmas_[p].cwiseAbs2();
    group.own.diagonal().head<6>() = information;
    group.gradient.head<6>() = information.cwiseProduct(state.panorama_deltas[p]);
    system.groups.push_back(std::move(group));
  }
  for (std::size_t s = 0; s < surfaces_.size(); ++s) {
    BundleGroup& group = system.groups[static_cast<std::size_t>(surfaces_[s].panorama)];
    const Eigen::Vector3d information = surfaces_[s].inverse_sigmas.cwiseAbs2();
    group.own.diagonal().segment<3>(surfaces_[s].column) = information;
    group.gradient.segment<3>(surfaces_[s].column) =
        information.cwiseProduct(state.surface_deltas[s]);
  }
  system.cost = 0.5 * PriorChi2(state);
  system.whiteners.assign(entries_.size(), Eigen::Matrix2d::Zero());
  system.norms.assign(entries_.size(), kUnusable);
  return system;
}

BundleSystem BundleProblem::Linearize(const BundleState& state, double tukey_t) const {
  BundleSystem system = PriorSystem(state);
  const Motions motions = Prepare(state);
  BundleLinear linear;
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    const Entry& e = entries_[i];
    if (LinearizeBundle(e.match, motions.Frame(e), motions.Panorama(e), motions.Surface(e),
                        &linear) &&
        std::isfinite(linear.residual.norm())) {
      system.norms[i] = linear.residual.norm();
      system.whiteners[i] = linear.whitener;
    }
    system.cost += TukeyRho(system.norms[i], tukey_t);
    const double weight = TukeyWeight(system.norms[i], tukey_t);
    if (weight <= 0) continue;
    const Eigen::Index at = 6 * e.frame;
    const Eigen::Matrix<double, 6, 2> frame = weight * linear.by_frame.transpose();
    system.frames.block<6, 6>(at, at).noalias() += frame * linear.by_frame;
    system.frame_gradient.segment<6>(at).noalias() += frame * linear.residual;
    if (e.panorama < 0) continue;
    BundleGroup& group = system.groups[static_cast<std::size_t>(e.panorama)];
    const Eigen::Matrix<double, 6, 2> panorama = weight * linear.by_panorama.transpose();
    group.own.topLeftCorner<6, 6>().noalias() += panorama * linear.by_panorama;
    group.gradient.head<6>().noalias() += panorama * linear.residual;
    group.cross.block<6, 6>(at, 0).noalias() += frame * linear.by_panorama;
    if (e.surface < 0) continue;
    const Eigen::Index column = surfaces_[static_cast<std::size_t>(e.surface)].column;
    const Eigen::Matrix<double, 3, 2> surface = weight * linear.by_surface.transpose();
    group.own.block<3, 6>(column, 0).noalias() += surface * linear.by_panorama;
    group.own.block<3, 3>(column, column).noalias() += surface * linear.by_surface;
    group.gradient.segment<3>(column).noalias() += surface * linear.residual;
    group.cross.block<6, 3>(at, column).noalias() += frame * linear.by_surface;
  }
  return system;
}

double BundleProblem::Cost(const BundleState& state, const BundleSystem& system,
                           double tukey_t) const {
  double cost = 0.5 * PriorChi2(state);
  const Motions motions = Prepare(state);
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    const Entry& e = entries_[i];
    Eigen::Vector2d residual;
    const bool usable = std::isfinite(system.norms[i]) &&
                        BundleResidual(e.match, system.whiteners[i], motions.Frame(e),
                                       motions.Panorama(e), motions.Surface(e), &residual);
    cost += TukeyRho(usable ? residual.norm() : kUnusable, tukey_t);
  }
  return cost;
}

BundleState BundleProblem::Moved(const BundleState& state, const BundleStep& step) const {
  BundleState moved = state;
  for (std::size_t f = 0; f < moved.cam_from_map.size(); ++f) {
    const Vector6d delta = step.frames.segment<6>(6 * static_cast<Eigen::Index>(f));
    moved.cam_from_map[f] = PerturbPose(state.cam_from_map[f], delta);
  }
  for (std::size_t p = 0; p < moved.panorama_deltas.size(); ++p)
    moved.panorama_deltas[p] += step.groups[p].head<6>();
  for (std::size_t s = 0; s < surfaces_.size(); ++s) {
    moved.surface_deltas[s] +=
        step.groups[static_cast<std::size_t>(surfaces_[s].panorama)].segment<3>(
            surfaces_[s].column);
  }
  return moved;
}

double BundleProblem::PriorChi2(const BundleState& state) const {
  double chi2 = 0;
  for (std::size_t p = 0; p < inverse_sigmas_.size(); ++p)
    chi2 += inverse_sigmas_[p].cwiseProduct(state.panorama_deltas[p]).squaredNorm();
  for (std::size_t s = 0; s < surfaces_.size(); ++s)
    chi2 += surfaces_[s].inverse_sigmas.cwiseProduct(state.surface_deltas[s]).squaredNorm();
  return chi2;
}

}  // namespace panofix
