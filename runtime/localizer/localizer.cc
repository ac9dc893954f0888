#include "runtime/localizer/localizer.h"

#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>

#include <algorithm>
#include <chrono>
#include <set>
#include <stdexcept>

#include "common/base/log.h"
#include "common/geometry/attitude.h"
#include "common/map/map_bundle.h"
#include "runtime/localizer/fix_history.h"
#include "runtime/pose/pose_estimator.h"
#include "runtime/retrieval/retrieval.h"

namespace panofix {
namespace {

// Views matched a frame: a window is sure of its place, a global search needs more tries.
constexpr int kWindowedViews = 8;
constexpr int kGlobalViews = 12;
class Stopwatch {
 public:
  // Milliseconds since the last lap.
  double Lap() {
    const auto now = std::chrono::steady_clock::now();
    const double ms = std::chrono::duration<double, std::milli>(now - last_).count();
    last_ = now;
    return ms;
  }

 private:
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

PoseOptions PoseOptionsFor(const LocalizerOptions& options, const Camera& camera) {
  PoseOptions pose;
  pose.ransac.focal_px = camera.fx_px;
  pose.ransac.seed = options.seed;
  pose.ransac.max_reproj_error_px = 4.0;
  if (options.preset == "paper") {
    pose.ransac.minimal_solver = MinimalSolver::kEpnp;
    pose.ransac.local_optimizations = 0;
    pose.ransac.max_reproj_error_px = 3.0;
    pose.refine.use_point_sigma = false;
    pose.use_guided = false;
    pose.min_inliers = 12;
  }
  return pose;
}

}  // namespace

void LocalizerOptions::Check() const {
  if (preset != "default" && preset != "paper") {
    throw std::invalid_argument("preset = '" + preset + "'; must be default or paper");
  }
  if (num_threads < 0)
    throw std::invalid_argument(Format("num_threads = %d; must not be negative", num_threads));
}

struct Localizer::Impl {
  Impl(std::shared_ptr<const MapBundle> map, const Camera& cam,
       const LocalizerOptions& localizer_options)
      : bundle(std::move(map)),
        retrieval(bundle),
        camera(cam),
        options(localizer_options),
        pose_options(PoseOptionsFor(localizer_options, cam)) {
    pose_options.use_guided = pose_options.use_guided && bundle->manifest().features.root_sift;
    if (options.num_threads > 0) {
      thread_limit =
          std::make_unique<tbb::global_control>(tbb::global_control::max_allowed_parallelism,
                                                static_cast<std::size_t>(options.num_threads));
    }
    const Manifest& manifest = bundle->manifest();
    identity.name = manifest.name;
    identity.id = bundle->id();
    identity.build = manifest.build;
    identity.num_panoramas = bundle->panoramas().size();
    identity.num_views = bundle->views().size();
  }

  FrameFeatures Extract(const GrayImage& frame, BagOfWords* bag, StageLatency* latency);
  PoseOutcome Solve(const FrameFeatures& features, const RetrievalResult& retrieved,
                    std::int64_t now_ns, LocalFrame* local, StageLatency* latency) const;
  void Run(const GrayImage& frame, FrameResult* result);  // result->timestamp_ns is set
  void Fill(const PoseOutcome& outcome, const LocalFrame& local, FrameResult* result) const;

  std::shared_ptr<const MapBundle> bundle;
  Retrieval retrieval;
  Camera camera;
  LocalizerOptions options;
  PoseOptions pose_options;
  BundleIdentity identity;
  std::unique_ptr<tbb::global_control> thread_limit;
  FixHistory history;
};

FrameFeatures Localizer::Impl::Extract(const GrayImage& frame, BagOfWords* bag,
                                       StageLatency* latency) {
  const FeatureOptions& contract = bundle->manifest().features;
  Stopwatch watch;
  const GrayImage image = Preprocess(frame, contract);
  latency->preprocess_ms = watch.Lap();
  FrameFeatures features;
  FeatureSet mser;
  tbb::parallel_invoke([&] { features.sift = ExtractSift(image, contract); },
                       [&] { mser = ExtractMser(image, contract); });
  for (const Keypoint& k : features.sift.keypoints) {
    features.bearings.push_back(camera.Normalize({double{k.x_px}, double{k.y_px}}));
  }
  const Vocabulary& vocabulary = bundle->vocabulary();
  *bag = vocabulary.Bag(vocabulary.SiftWords(features.sift), vocabulary.MserWords(mser));
  latency->features_ms = watch.Lap();
  return features;
}

PoseOutcome Localizer::Impl::Solve(const FrameFeatures& features, const RetrievalResult& retrieved,
                                   std::int64_t now_ns, LocalFrame* local,
                                   StageLatency* latency) const {
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
  std::vector<Rigid3> predictions;
  for (const Rigid3& map_from_cam : history.Predictions(now_ns)) {
    predictions.push_back(
        Rigid3(map_from_cam.rotation, local->FromMap(map_from_cam.translation)).Inverse());
  }
  PoseOutcome outcome =
      EstimatePose(matches, predictions, features, camera, *bundle, *local, pose_options);
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

void Localizer::Impl::Run(const GrayImage& frame, FrameResult* result) {
  BagOfWords bag;
  const FrameFeatures features = Extract(frame, &bag, &result->latency);
  constexpr std::size_t kFewestFeatures = 20;
  if (features.sift.size() < kFewestFeatures) {
    result->reason = "too_few_features";
    history.Lose();
    return;
  }
  // The window of the last fix first; the whole map where that fails.
  for (const bool windowed : {true, false}) {
    if (windowed && history.seeds().empty()) continue;
    Stopwatch watch;
    const RetrievalResult retrieved = windowed
                                          ? retrieval.Windowed(bag, history.seeds(), kWindowedViews)
                                          : retrieval.Global(bag, kGlobalViews);
    result->latency.retrieval_ms += watch.Lap();
    // Distinct views: a window lies within the whole map.
    result->num_compared = std::max(result->num_compared, retrieved.num_compared);
    if (retrieved.views.empty()) {
      result->reason = "nothing_similar";
      continue;
    }
    LocalFrame local;
    const PoseOutcome outcome =
        Solve(features, retrieved, result->timestamp_ns, &local, &result->latency);
    result->reason = outcome.reason;
    result->num_inliers = outcome.num_inliers;
    result->num_views = static_cast<int>(outcome.views.size());
    if (!outcome.trusted) continue;
    Fill(outcome, local, result);
    result->best_panorama = bundle->panoramas()[bundle->views()[outcome.best_view].panorama_idx].id;
    history.Add(result->timestamp_ns,
                Rigid3(result->pose->map_from_cam, result->pose->position_in_map), outcome.views,
                outcome.degraded);
    return;
  }
  history.Lose();
}

Localizer::Localizer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Localizer::~Localizer() = default;

Result<std::unique_ptr<Localizer>> Localizer::Open(const std::filesystem::path& bundle,
                                                   const Camera& camera,
                                                   const LocalizerOptions& options) {
  try {
    options.Check();
    Status status = camera.Check();
    if (!status.ok()) return status;
    auto map = MapBundle::Open(bundle);
    if (!map.ok()) return map.status();
    return std::unique_ptr<Localizer>(
        new Localizer(std::make_unique<Impl>(std::move(map).value(), camera, options)));
  } catch (const std::invalid_argument& error) {
    return Status(ErrorCode::kInvalidArgument, error.what());
  } catch (const std::exception& error) {
    return Status(ErrorCode::kInternal, bundle.string() + ": " + error.what());
  }
}

Result<Camera> Localizer::ReadBundleCamera(const std::filesystem::path& bundle) {
  std::string id;
  auto manifest = MapBundle::ReadManifest(bundle, &id);
  if (!manifest.ok()) return manifest.status();
  return manifest->camera;
}

FrameResult Localizer::Localize(std::int64_t timestamp_ns, const GrayImage& frame) {
  FrameResult result;
  result.timestamp_ns = timestamp_ns;
  result.num_database = static_cast<std::int64_t>(impl_->bundle->views().size());
  const auto start = std::chrono::steady_clock::now();
  LogDebug(Format("frame %lld", static_cast<long long>(timestamp_ns)));
  try {
    if (frame.width_px != impl_->camera.width_px || frame.height_px != impl_->camera.height_px) {
      result.reason = "frame_size_differs_from_camera";
    } else {
      impl_->history.Advance(timestamp_ns);
      impl_->Run(frame, &result);
    }
  } catch (const std::exception& error) {
    Log(LogLevel::kError,
        Format("frame %lld: %s", static_cast<long long>(timestamp_ns), error.what()));
    result = FrameResult{};
    result.timestamp_ns = timestamp_ns;
    result.reason = "internal_error";
  }
  result.latency.total_ms =
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  return result;
}

FrameResult Localizer::Undecodable(std::int64_t timestamp_ns) const {
  FrameResult result;
  result.timestamp_ns = timestamp_ns;
  result.reason = "frame_undecodable";
  return result;
}

const BundleIdentity& Localizer::bundle() const { return impl_->identity; }
const Camera& Localizer::camera() const { return impl_->camera; }

PoseSigmas SigmasOf(const FramePose& pose) {
  const Eigen::Quaterniond enu_from_map = pose.enu_from_cam * pose.map_from_cam.conjugate();
  const Eigen::Matrix3d R = enu_from_map.toRotationMatrix();
  const Eigen::Matrix3d position = R * pose.covariance_in_map.topLeftCorner<3, 3>() * R.transpose();
  // A variance may round to just below zero.
  const auto sigma = [](double variance) { return std::sqrt(std::max(0.0, variance)); };
  return {sigma(position(0, 0)), sigma(position(1, 1)), sigma(position(2, 2)),
          sigma(pose.covariance_in_map(5, 5)) / kRadPerDeg};
}

PoseRow ToPoseRow(const FrameResult& result) {
  PoseRow row;
  row.timestamp_ns = result.timestamp_ns;
  row.status = result.status;
  row.reason = result.reason;
  row.num_inliers = result.num_inliers;
  row.num_views = result.num_views;
  row.best_panorama = result.best_panorama;
  row.latency_ms = result.latency.total_ms;
  if (result.pose) {
    const PoseSigmas sigmas = SigmasOf(*result.pose);
    row.pose = PoseColumns{result.pose->position, result.pose->attitude, result.pose->enu_from_cam,
                           sigmas.east_m,         sigmas.north_m,        sigmas.up_m,
                           sigmas.heading_deg};
  }
  return row;
}

RunLogEntry ToRunLogEntry(const FrameResult& result) {
  return {result.timestamp_ns, result.latency, result.num_compared, result.num_database};
}

}  // namespace panofix
