#include "runtime/localizer/localizer.h"

#include <algorithm>
#include <chrono>
#include <stdexcept>

#include "common/base/log.h"
#include "runtime/localizer/localizer_impl.h"

namespace panofix {
namespace {

constexpr const char* kDeadline = "deadline";

}  // namespace

void LocalizerOptions::Check() const {
  (void)ResolveLevers(preset, add);
  if (num_threads < 0)
    throw std::invalid_argument(Format("num_threads = %d; must not be negative", num_threads));
}

bool Localizer::Impl::IsLate(FrameResult* result) {
  if (turn.owns_lock() && !is_first_of_map) {
    turn.unlock();
    turn.lock();
  }
  if (!time_is_up || !time_is_up()) return false;
  result->reason = kDeadline;
  return true;
}

void Localizer::Impl::Run(const GrayImage& frame, FrameResult* result) {
  votes.clear();
  if (IsLate(result)) return;
  Stopwatch watch;
  const GrayImage image = Preprocess(frame, bundle->manifest().features);
  result->latency.preprocess_ms = watch.Lap();
  if (TrackCoarse(image, result) || IsLate(result)) return;
  const FrameFeatures features = ExtractFeatures(image, Detail::kFull, &result->latency);
  constexpr std::size_t kFewestFeatures = 20;
  if (features.sift.size() < kFewestFeatures) {
    result->reason = "too_few_features";
    return;
  }
  if (IsLate(result)) return;
  if (!levers.tracking) return RunUntracked(image, features, result);
  if (Track(features, result) || IsLate(result) || Bridge(features, Bridging::kAny, result)) return;
  if (IsLate(result)) return;
  const BagOfWords bag = MakeBag(image, features, &result->latency);
  // Where the vehicle must be first; the whole map where that fails.
  for (const bool windowed : {true, false}) {
    const std::vector<std::uint32_t> window = windowed ? Window() : std::vector<std::uint32_t>{};
    if (windowed && window.empty()) continue;
    if (IsLate(result)) return;
    const RetrievalResult retrieved =
        Retrieve({bag, features.sift, features.bearings, camera, [&] { return IsLate(result); }},
                 window, result);
    if (result->reason == kDeadline) return;
    if (retrieved.views.empty()) {
      result->reason = "nothing_similar";
      continue;
    }
    if (IsLate(result)) return;
    LocalFrame local;
    PoseOutcome outcome = Solve(features, retrieved, &local, &result->latency);
    Confirm(local, result->timestamp_ns, &outcome);
    if (Accept(features, outcome, local, result)) return;
    if (windowed) places.UpdateNoFix(window);
  }
}

// The paper's chain, or what levers make of it: each frame on its own but for the window, which
// lies around the views that the last one retrieved, fix or not.
void Localizer::Impl::RunUntracked(const GrayImage& image, const FrameFeatures& features,
                                   FrameResult* result) {
  const BagOfWords bag = MakeBag(image, features, &result->latency);
  Stopwatch watch;
  const RetrievalResult retrieved = retrieval.InRows(
      {bag, features.sift, features.bearings, camera, {}}, last_retrieved, levers.ranked);
  result->latency.retrieval_ms = watch.Lap();
  result->num_compared = retrieved.num_compared;
  if (retrieved.views.empty()) {
    result->reason = "nothing_similar";
    return;
  }
  std::vector<std::uint32_t> views;
  for (const RetrievedView& view : retrieved.views) views.push_back(view.view_idx);
  if (!levers.exhaustive) last_retrieved = views;
  const LocalFrame local =
      LocalFrame::At(bundle->panoramas()[bundle->views()[views.front()].panorama_idx]);
  const std::vector<ViewMatches> matches = matcher->Match(features, image, views, local);
  result->latency.matching_ms = watch.Lap();
  const PoseOutcome outcome =
      levers.pooled ? EstimatePose(Context(features, local), matches)
                    : EstimatePaperPose(matches, bundle->manifest().errors, paper_options);
  result->latency.pose_ms = watch.Lap();
  (void)Accept(features, outcome, local, result);
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
    auto map = MapBundle::Open(bundle, options.trusted_keys, options.max_memory_bytes / 4);
    if (!map.ok()) return map.status();
    std::unique_ptr<Localizer> localizer(new Localizer(std::make_unique<Impl>(
        std::make_shared<OpenMap>(std::move(map).value(), options), true, camera, options)));
    if (!localizer->bundle().is_signed) {
      LogWarning(bundle.string() +
                 ": the map's signature is not verified; for development only. Give --trusted-key, "
                 "or install the bundle into a store");
    }
    return localizer;
  } catch (const std::invalid_argument& error) {
    return Status(ErrorCode::kInvalidArgument, error.what());
  } catch (const std::exception& error) {
    return Status(ErrorCode::kInternal, bundle.string() + ": " + error.what());
  }
}

Result<std::unique_ptr<Localizer>> Localizer::Another() const {
  try {
    return std::unique_ptr<Localizer>(new Localizer(
        std::make_unique<Impl>(impl_->open_map, false, impl_->camera, impl_->options)));
  } catch (const std::exception& error) {
    return Status(ErrorCode::kInternal, std::string("another localizer: ") + error.what());
  }
}

Result<Camera> Localizer::ReadBundleCamera(const std::filesystem::path& bundle) {
  std::string id;
  auto manifest = MapBundle::ReadManifest(bundle, &id);
  if (!manifest.ok()) return manifest.status();
  return manifest->camera;
}

FrameResult Localizer::Localize(std::int64_t timestamp_ns, const GrayImage& frame,
                                const TimeIsUp& time_is_up) {
  FrameResult result;
  result.timestamp_ns = timestamp_ns;
  result.num_database = static_cast<std::int64_t>(impl_->bundle->views().size());
  result.map_is_unsigned = !impl_->identity.is_signed;
  const auto start = std::chrono::steady_clock::now();
  LogDebug(Format("frame %lld", static_cast<long long>(timestamp_ns)));
  impl_->time_is_up = time_is_up;
  if (impl_->options.max_memory_bytes > 0) impl_->turn = std::unique_lock(impl_->open_map->turns);
  try {
    if (frame.width_px != impl_->camera.width_px || frame.height_px != impl_->camera.height_px) {
      result.reason = "frame_size_differs_from_camera";
    } else {
      impl_->Advance(timestamp_ns);
      impl_->Run(frame, &result);
      impl_->FollowTiles(result);
    }
  } catch (const std::exception& error) {
    Log(LogLevel::kError,
        Format("frame %lld: %s", static_cast<long long>(timestamp_ns), error.what()));
    result = FrameResult{};
    result.timestamp_ns = timestamp_ns;
    result.reason = "internal_error";
    result.map_is_unsigned = !impl_->identity.is_signed;
  }
  if (impl_->turn.owns_lock()) impl_->turn.unlock();
  result.latency.total_ms =
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  return result;
}

FrameResult Localizer::Undecodable(std::int64_t timestamp_ns) const {
  FrameResult result;
  result.timestamp_ns = timestamp_ns;
  result.reason = "frame_undecodable";
  result.map_is_unsigned = !impl_->identity.is_signed;
  return result;
}

void Localizer::Forget() {
  impl_->history = FixHistory();
  impl_->calibration = CalibrationWatch();
  impl_->rivals = RivalWatch();
  impl_->finds = FindWatch();
  impl_->past = PastFrames();
  impl_->recent = RecentFrames();
  impl_->last_is_distinct = false;
  impl_->last_in_map.reset();
  impl_->coarse_pause = 0;
  impl_->next_coarse_pause = Impl::kShortPause;
  impl_->places.Reset();
  impl_->last_retrieved.clear();
  impl_->has_last_frame = false;
}

TileMemory Localizer::memory() const { return impl_->retrieval.memory(); }
const MapBundle& Localizer::map() const { return *impl_->bundle; }
const BundleIdentity& Localizer::bundle() const { return impl_->identity; }
const Camera& Localizer::camera() const { return impl_->camera; }

}  // namespace panofix
