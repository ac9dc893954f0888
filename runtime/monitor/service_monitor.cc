#include "runtime/monitor/service_monitor.h"

#include <Eigen/Eigenvalues>
#include <cmath>

#include "common/geometry/attitude.h"

namespace panofix {
namespace {

std::array<double, kNumServiceStages> StagesOf(const FrameResult& result, double wait_ms,
                                               double decode_ms) {
  const StageLatency& l = result.latency;
  return {wait_ms,        decode_ms,     l.preprocess_ms, l.features_ms,
          l.retrieval_ms, l.matching_ms, l.pose_ms,       wait_ms + decode_ms + l.total_ms};
}

// The horizontal part of a pose's covariance, turned to east and north, as an ellipse.
void SetEllipse(const FramePose& pose, TrailPoint* point) {
  const Eigen::Matrix3d enu_from_map =
      (pose.enu_from_cam * pose.map_from_cam.conjugate()).normalized().toRotationMatrix();
  const Eigen::Matrix3d in_enu =
      enu_from_map * pose.covariance_in_map.topLeftCorner<3, 3>() * enu_from_map.transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> axes(in_enu.topLeftCorner<2, 2>());
  const auto sigma = [](double variance) { return std::sqrt(std::max(variance, 0.0)); };
  point->sigma_short_m = sigma(axes.eigenvalues()[0]);
  point->sigma_long_m = sigma(axes.eigenvalues()[1]);
  const Eigen::Vector2d along = axes.eigenvectors().col(1);
  point->sigma_turn_deg = std::atan2(along.x(), along.y()) / kRadPerDeg;
}

}  // namespace

const char* ServiceStageName(ServiceStage stage) {
  switch (stage) {
    case ServiceStage::kWait:
      return "wait";
    case ServiceStage::kDecode:
      return "decode";
    case ServiceStage::kPreprocess:
      return "preprocess";
    case ServiceStage::kFeatures:
      return "features";
    case ServiceStage::kRetrieval:
      return "retrieval";
    case ServiceStage::kMatching:
      return "matching";
    case ServiceStage::kPose:
      return "pose";
    case ServiceStage::kTotal:
      return "total";
  }
  return "";
}

void ServiceMonitor::SetMap(MapFacts facts) {
  const std::lock_guard lock(mutex_);
  counts_.bundle = facts.bundle;
  counts_.map_created_s = facts.created_s;
  counts_.num_tiles = facts.num_tiles;
  map_ = std::move(facts);
}

void ServiceMonitor::SetFeed(const FeedCounts& counts) {
  const std::lock_guard lock(mutex_);
  counts_.feed = counts;
}

void ServiceMonitor::Step() {
  const std::lock_guard lock(mutex_);
  step_ = Clock::now();
}

void ServiceMonitor::AddAnswer(const FrameResult& result, double wait_ms, double decode_ms) {
  TrailPoint point;
  point.timestamp_ns = result.timestamp_ns;
  point.status = result.status;
  point.reason = result.reason;
  point.num_inliers = result.num_inliers;
  point.best_panorama = result.best_panorama;
  point.stages_ms = StagesOf(result, wait_ms, decode_ms);
  if (result.pose) {
    point.position = result.pose->position;
    point.heading_deg = result.pose->attitude.heading_deg;
    SetEllipse(*result.pose, &point);
  }
  const std::lock_guard lock(mutex_);
  // Only what a map was asked for makes the service ready.
  if (result.reason != "map_loading") answer_ = Clock::now();
  if (result.status == FixStatus::kFix) {
    fix_ = answer_;
    ++counts_.num_fixes;
  }
  ++counts_.answers[{result.status, result.reason}];
  for (std::size_t i = 0; i < kNumServiceStages; ++i) counts_.latency[i].Add(point.stages_ms[i]);
  point.number = ++counts_.num_answers;
  trail_.push_back(std::move(point));
  if (trail_.size() > kTrailPoints) trail_.pop_front();
}

void ServiceMonitor::Count(std::int64_t MonitorSnapshot::*counter, std::int64_t by) {
  const std::lock_guard lock(mutex_);
  counts_.*counter += by;
}

void ServiceMonitor::Set(std::int64_t MonitorSnapshot::*counter, std::int64_t value) {
  const std::lock_guard lock(mutex_);
  counts_.*counter = value;
}

MonitorSnapshot ServiceMonitor::Snapshot() const {
  const std::lock_guard lock(mutex_);
  const auto now = Clock::now();
  const auto since_s = [&](const auto& time) {
    return time ? std::optional(std::chrono::duration<double>(now - *time).count()) : std::nullopt;
  };
  MonitorSnapshot snapshot = counts_;
  snapshot.uptime_s = std::chrono::duration<double>(now - start_).count();
  snapshot.since_step_s = since_s(step_);
  snapshot.since_answer_s = since_s(answer_);
  snapshot.since_fix_s = since_s(fix_);
  return snapshot;
}

std::vector<TrailPoint> ServiceMonitor::TrailAfter(std::int64_t number) const {
  const std::lock_guard lock(mutex_);
  // Numbers are consecutive: the first one kept tells where to begin.
  std::size_t begin = 0;
  if (!trail_.empty() && number >= trail_.front().number) {
    begin = std::min(trail_.size(), static_cast<std::size_t>(number - trail_.front().number + 1));
  }
  return {trail_.begin() + static_cast<std::ptrdiff_t>(begin), trail_.end()};
}

void ServiceMonitor::SetPicture(FramePicture picture) {
  const std::lock_guard lock(mutex_);
  picture_ = std::move(picture);
}

FramePicture ServiceMonitor::picture() const {
  const std::lock_guard lock(mutex_);
  return picture_;
}

MapFacts ServiceMonitor::map() const {
  const std::lock_guard lock(mutex_);
  return map_;
}

}  // namespace panofix
