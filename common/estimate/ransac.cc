// LO-RANSAC. Matches are centred once and held as arrays of floats, so that a hypothesis is scored
// in vector registers; refits run in doubles. Poses in this file are in the centred frame.

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

#include "common/base/rng.h"
#include "common/estimate/pnp.h"
#include "common/estimate/projection.h"

namespace panofix {
namespace {

constexpr int kBlock = 16;  // floats scored between two looks at the best score
constexpr float kMinDepthFloat_m = 0.1F;
constexpr double kMaxExtent_m = 1e5;  // farther points and wider bearings are not used
constexpr double kMaxBearing = 1e3;
constexpr double kMinSampleShape = 0.01;  // twice a triangle's area over its longest side squared
constexpr double kMinSampleSide_m = 0.01;
constexpr std::size_t kMaxRefitMatches = 200;

using Floats = Eigen::Array<float, kBlock, 1>;

struct Hypothesis {
  Rigid3 cam_from_map;
  float cost = 0;  // MSAC: sum of min(error^2 / threshold^2, 1)
};

void Require(bool ok, const char* field, double value, const char* rule) {
  if (!ok) {
    throw std::invalid_argument("RansacOptions." + std::string(field) + " = " +
                                std::to_string(value) + ": must be " + rule);
  }
}

bool IsUsable(const Correspondence& match) {
  return match.bearing_in_cam.cwiseAbs().maxCoeff() < kMaxBearing &&
         match.point_in_map.cwiseAbs().maxCoeff() < 1e12 && match.bearing_in_cam.allFinite() &&
         match.point_in_map.allFinite();
}

// Per-coordinate median: one absurd point does not move it.
Eigen::Vector3d MedianPoint(const std::vector<Correspondence>& matches) {
  Eigen::Vector3d median = Eigen::Vector3d::Zero();
  std::vector<double> values(matches.size());
  for (Eigen::Index axis = 0; axis < 3 && !matches.empty(); ++axis) {
    std::transform(matches.begin(), matches.end(), values.begin(),
                   [axis](const Correspondence& match) { return match.point_in_map[axis]; });
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    median[axis] = *middle;
  }
  return median;
}

class PoseRansac {
 public:
  PoseRansac(std::span<const Correspondence> matches, const RansacOptions& options)
      : options_(options),
        threshold_(options.max_reproj_error_px / options.focal_px),
        rng_(options.seed, "estimate/ransac") {
    for (std::size_t i = 0; i < matches.size(); ++i) {
      if (!IsUsable(matches[i])) continue;
      source_.push_back(static_cast<int>(i));
      matches_.push_back(matches[i]);
    }
    centre_ = MedianPoint(matches_);
    std::size_t kept = 0;
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      matches_[i].point_in_map -= centre_;
      if (matches_[i].point_in_map.cwiseAbs().maxCoeff() > kMaxExtent_m) continue;
      source_[kept] = source_[i];
      matches_[kept++] = matches_[i];
    }
    source_.resize(kept), matches_.resize(kept);
    PackFloats();
  }

  RansacResult Run();

 private:
  void PackFloats();
  [[nodiscard]] float Cost(const Rigid3& cam_from_map, float best_cost) const;
  [[nodiscard]] std::vector<int> Inliers(const Rigid3& cam_from_map, double threshold) const;
  [[nodiscard]] bool DrawSample();
  void SolveSample(std::vector<Rigid3>* poses) const;
  [[nodiscard]] bool Refit(std::span<const int> indices, int iterations, Rigid3* pose) const;
  void Offer(const Rigid3& cam_from_map, Hypothesis* best) const;
  void OptimizeLocally(Hypothesis* best);
  void Finish(Hypothesis* best) const;
  [[nodiscard]] Rigid3 Uncentred(const Rigid3& cam_from_centred) const {
    return {cam_from_centred.rotation,
            cam_from_centred.translation - cam_from_centred.rotation * centre_};
  }
  [[nodiscard]] int IterationsNeeded(std::size_t num_inliers) const;
  [[nodiscard]] int SampleSize() const {
    const int wanted = options_.minimal_solver == MinimalSolver::kP3p ? 3 : 5;
    return std::min(wanted, static_cast<int>(matches_.size()));
  }
  [[nodiscard]] const Correspondence& Match(int index) const {
    return matches_[static_cast<std::size_t>(index)];
  }

  const RansacOptions options_;
  const double threshold_;
  Rng rng_;
  std::vector<int> source_;              // index in the caller's span
  std::vector<Correspondence> matches_;  // usable ones, centred
  Eigen::Vector3d centre_;
  Eigen::ArrayXf x_, y_, z_, u_, v_;  // the same, padded to whole blocks
  std::vector<int> sample_;
};

void PoseRansac::PackFloats() {
  const auto size = static_cast<Eigen::Index>(matches_.size());
  const Eigen::Index padded = (size + kBlock - 1) / kBlock * kBlock;
  for (Eigen::ArrayXf* array : {&x_, &y_, &z_, &u_, &v_}) array->setZero(padded);
  u_.setConstant(1e6F);  // padding is an outlier of every pose
  for (Eigen::Index i = 0; i < size; ++i) {
    const Correspondence& match = matches_[static_cast<std::size_t>(i)];
    x_[i] = static_cast<float>(match.point_in_map.x());
    y_[i] = static_cast<float>(match.point_in_map.y());
    z_[i] = static_cast<float>(match.point_in_map.z());
    u_[i] = static_cast<float>(match.bearing_in_cam.x());
    v_[i] = static_cast<float>(match.bearing_in_cam.y());
  }
}

// Stops early, with what it has, once `best_cost` cannot be beaten any more.
float PoseRansac::Cost(const Rigid3& cam_from_map, float best_cost) const {
  const Eigen::Matrix3f r = cam_from_map.rotation.toRotationMatrix().cast<float>();
  const Eigen::Vector3f t = cam_from_map.translation.cast<float>();
  const auto scale = static_cast<float>(1 / (threshold_ * threshold_));
  float cost = 0;
  for (Eigen::Index i = 0; i < x_.size() && cost < best_cost; i += kBlock) {
    const auto x = x_.segment<kBlock>(i), y = y_.segment<kBlock>(i), z = z_.segment<kBlock>(i);
    const Floats depth = x * r(2, 0) + y * r(2, 1) + z * r(2, 2) + t[2];
    const Floats inverse = depth.max(kMinDepthFloat_m).inverse();
    const Floats du =
        (x * r(0, 0) + y * r(0, 1) + z * r(0, 2) + t[0]) * inverse - u_.segment<kBlock>(i);
    const Floats dv =
        (x * r(1, 0) + y * r(1, 1) + z * r(1, 2) + t[1]) * inverse - v_.segment<kBlock>(i);
    const Floats error = ((du * du + dv * dv) * scale).min(1.0F);
    const Floats ones = Floats::Ones();
    cost += (depth >= kMinDepthFloat_m).select(error, ones).sum();
  }
  return cost;
}

std::vector<int> PoseRansac::Inliers(const Rigid3& cam_from_map, double threshold) const {
  const CameraFrame frame(cam_from_map);
  std::vector<int> inliers;
  for (std::size_t i = 0; i < matches_.size(); ++i) {
    const Eigen::Vector3d point = frame.ToCam(matches_[i].point_in_map);
    if (!(point.z() >= kMinDepth_m)) continue;
    const Eigen::Vector2d residual = point.head<2>() / point.z() - matches_[i].bearing_in_cam;
    if (residual.squaredNorm() <= threshold * threshold) inliers.push_back(static_cast<int>(i));
  }
  return inliers;
}

// False where the sample cannot fix a pose: coincident or collinear points, one bearing twice.
bool PoseRansac::DrawSample() {
  sample_.clear();
  while (static_cast<int>(sample_.size()) < SampleSize()) {
    const int index = static_cast<int>(rng_.Below(matches_.size()));
    if (std::find(sample_.begin(), sample_.end(), index) == sample_.end()) sample_.push_back(index);
  }
  for (std::size_t i = 0; i < sample_.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const Correspondence &a = Match(sample_[i]), &b = Match(sample_[j]);
      if ((a.point_in_map - b.point_in_map).squaredNorm() < kMinSampleSide_m * kMinSampleSide_m ||
          (a.bearing_in_cam - b.bearing_in_cam).squaredNorm() < threshold_ * threshold_) {
        return false;
      }
    }
  }
  // Some triangle of the sample must span an area.
  double best_shape = 0;
  const Eigen::Vector3d& origin = Match(sample_[0]).point_in_map;
  for (std::size_t i = 1; i < sample_.size(); ++i) {
    for (std::size_t j = i + 1; j < sample_.size(); ++j) {
      const Eigen::Vector3d a = Match(sample_[i]).point_in_map - origin;
      const Eigen::Vector3d b = Match(sample_[j]).point_in_map - origin;
      const double longest = std::max({a.squaredNorm(), b.squaredNorm(), (a - b).squaredNorm()});
      best_shape = std::max(best_shape, a.cross(b).norm() / longest);
    }
  }
  return best_shape > kMinSampleShape;
}

void PoseRansac::SolveSample(std::vector<Rigid3>* poses) const {
  poses->clear();
  if (options_.minimal_solver == MinimalSolver::kP3p) {
    std::array<Eigen::Vector3d, 3> rays, points;
    for (std::size_t i = 0; i < 3; ++i) {
      rays[i] = Match(sample_[i]).bearing_in_cam.homogeneous().normalized();
      points[i] = Match(sample_[i]).point_in_map;
    }
    *poses = SolveP3p(rays, points);
    return;
  }
  std::vector<Correspondence> sample;
  for (const int index : sample_) sample.push_back(Match(index));
  Rigid3 pose;
  if (SolveEpnp(sample, &pose)) poses->push_back(pose);
}

// Gauss-Newton on the reprojection errors of `indices`; false where their pose is not determined.
bool PoseRansac::Refit(std::span<const int> indices, int iterations, Rigid3* pose) const {
  if (indices.size() < 4) return false;
  const std::size_t stride = (indices.size() + kMaxRefitMatches - 1) / kMaxRefitMatches;
  for (int iteration = 0; iteration < iterations; ++iteration) {
    const CameraFrame frame(*pose);
    Eigen::Matrix<double, 6, 6> normal = Eigen::Matrix<double, 6, 6>::Zero();
    Vector6d gradient = Vector6d::Zero();
    for (std::size_t i = 0; i < indices.size(); i += stride) {
      const Correspondence& match = Match(indices[i]);
      const Eigen::Vector3d point = frame.ToCam(match.point_in_map);
      if (!(point.z() >= kMinDepth_m)) continue;
      const Matrix26d jacobian =
          PoseJacobian(PointJacobian(frame, point), match.point_in_map - frame.position_in_map);
      const Eigen::Vector2d residual = point.head<2>() / point.z() - match.bearing_in_cam;
      normal.noalias() += jacobian.transpose() * jacobian;
      gradient.noalias() += jacobian.transpose() * residual;
    }
    const Eigen::LDLT<Eigen::Matrix<double, 6, 6>> solver(normal);
    if (solver.info() != Eigen::Success || !solver.isPositive()) return false;
    const Vector6d step = -solver.solve(gradient);
    // A step of kilometres or half turns is a singular system, not an improvement.
    if (!step.allFinite() || step.head<3>().norm() > 1e3 || step.tail<3>().norm() > 3) return false;
    *pose = PerturbPose(*pose, step);
  }
  return true;
}

void PoseRansac::Offer(const Rigid3& cam_from_map, Hypothesis* best) const {
  const float cost = Cost(cam_from_map, best->cost);
  if (cost < best->cost) *best = {cam_from_map, cost};
}

// Each round: fit a random half of the inliers, then all of them under a shrinking threshold.
void PoseRansac::OptimizeLocally(Hypothesis* best) {
  for (int round = 0; round < options_.local_optimizations; ++round) {
    Rigid3 pose = best->cam_from_map;
    std::vector<int> inliers = Inliers(pose, threshold_);
    if (inliers.size() < 4) return;
    if (round > 0) {
      const std::size_t half =
          std::min(inliers.size(), std::max<std::size_t>(7, inliers.size() / 2));
      for (std::size_t i = 0; i < half; ++i) {
        std::swap(inliers[i],
                  inliers[i + static_cast<std::size_t>(rng_.Below(inliers.size() - i))]);
      }
      inliers.resize(half);
      if (!Refit(inliers, 2, &pose)) continue;
    }
    for (const double widening : {2.0, 1.5, 1.0}) {
      if (!Refit(Inliers(pose, widening * threshold_), 2, &pose)) break;
      Offer(pose, best);
    }
  }
}

// Refits on all inliers until the score stops falling.
void PoseRansac::Finish(Hypothesis* best) const {
  for (int i = 0; i < 5; ++i) {
    Rigid3 pose = best->cam_from_map;
    const float before = best->cost;
    if (!Refit(Inliers(pose, threshold_), 3, &pose)) return;
    Offer(pose, best);
    if (!(best->cost < before)) return;
  }
}

int PoseRansac::IterationsNeeded(std::size_t num_inliers) const {
  const double share = static_cast<double>(num_inliers) / static_cast<double>(matches_.size());
  const double all_inliers = std::pow(share, SampleSize());
  if (all_inliers >= 1) return options_.min_iterations;
  const double needed = std::log1p(-options_.success_probability) / std::log1p(-all_inliers);
  if (!(needed < options_.max_iterations)) return options_.max_iterations;
  return std::max(options_.min_iterations, static_cast<int>(std::ceil(needed)));
}

RansacResult PoseRansac::Run() {
  RansacResult result;
  if (matches_.size() < 4) return result;
  Hypothesis best;
  best.cost = static_cast<float>(x_.size());
  std::vector<Rigid3> poses;
  int needed = options_.max_iterations, tried = 0;
  bool found = false;
  // Degenerate samples count against the bound on time, not against the probability of success.
  while (result.iterations < options_.max_iterations && tried < needed) {
    ++result.iterations;
    if (!DrawSample()) continue;
    ++tried;
    SolveSample(&poses);
    const float before = best.cost;
    for (const Rigid3& pose : poses) {
      if (!options_.bounds || options_.bounds->Hold(Uncentred(pose))) Offer(pose, &best);
    }
    if (!(best.cost < before)) continue;
    found = true;
    OptimizeLocally(&best);
    needed = IterationsNeeded(Inliers(best.cam_from_map, threshold_).size());
  }
  if (!found) return result;
  if (options_.local_optimizations > 0) Finish(&best);
  const std::vector<int> inliers = Inliers(best.cam_from_map, threshold_);
  result.cam_from_map = Uncentred(best.cam_from_map);
  for (const int index : inliers) {
    result.inliers.push_back(source_[static_cast<std::size_t>(index)]);
  }
  result.success =
      result.inliers.size() >= static_cast<std::size_t>(std::max(4, options_.min_inliers));
  return result;
}

}  // namespace

bool PoseBounds::Hold(const Rigid3& pose_cam_from_map) const {
  const Eigen::Vector3d shift =
      pose_cam_from_map.Inverse().translation - cam_from_map.Inverse().translation;
  const Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  const double cos_tilt = (pose_cam_from_map.rotation * up).dot(cam_from_map.rotation * up);
  return shift.head<2>().norm() <= max_distance_m && std::abs(shift.z()) <= max_height_off_m &&
         std::acos(std::clamp(cos_tilt, -1.0, 1.0)) <= max_tilt_rad;
}

void RansacOptions::Check() const {
  Require(max_reproj_error_px > 0 && std::isfinite(max_reproj_error_px), "max_reproj_error_px",
          max_reproj_error_px, "positive and finite");
  Require(focal_px > 0 && std::isfinite(focal_px), "focal_px", focal_px, "positive and finite");
  Require(min_iterations >= 1, "min_iterations", min_iterations, "1 or more");
  Require(max_iterations >= min_iterations, "max_iterations", max_iterations,
          "no less than min_iterations");
  Require(success_probability > 0 && success_probability < 1, "success_probability",
          success_probability, "within (0, 1)");
  Require(min_inliers >= 4, "min_inliers", min_inliers, "4 or more");
  Require(local_optimizations >= 0, "local_optimizations", local_optimizations, "0 or more");
}

RansacResult EstimatePoseRansac(std::span<const Correspondence> matches,
                                const RansacOptions& options) {
  options.Check();
  return PoseRansac(matches, options).Run();
}

}  // namespace panofix
