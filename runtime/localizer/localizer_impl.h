#pragma once
// What a localizer holds and the steps of a frame; private to this module.

#include <tbb/global_control.h>

#include <chrono>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "common/map/map_bundle.h"
#include "runtime/localizer/calibration_watch.h"
#include "runtime/localizer/estimator_options.h"
#include "runtime/localizer/fair_mutex.h"
#include "runtime/localizer/find_watch.h"
#include "runtime/localizer/fix_history.h"
#include "runtime/localizer/localizer.h"
#include "runtime/localizer/past_frames.h"
#include "runtime/localizer/rival_watch.h"
#include "runtime/pose/bridge.h"
#include "runtime/pose/pose_estimator.h"
#include "runtime/retrieval/retrieval.h"
#include "runtime/tracking/place_filter.h"

namespace panofix {

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

[[nodiscard]] PlaceGraph PlaceGraphOf(const MapBundle& bundle);
[[nodiscard]] PoseOptions CoarseOptions(PoseOptions options);

// What the localizers of one map share.
struct OpenMap {
  OpenMap(std::shared_ptr<const MapBundle> map, const LocalizerOptions& options)
      : bundle(std::move(map)),
        retrieval(bundle, RetrievalOptionsFor(ResolveLevers(options.preset, options.add), *bundle,
                                              options.max_memory_bytes)) {}
  std::shared_ptr<const MapBundle> bundle;
  Retrieval retrieval;
  FairMutex turns;  // held by who looks at tiles where they may be dropped: memory is bounded
};

struct Localizer::Impl {
  // `is_first`: tiles come and go with its motion; the map's other localizers wait for it.
  Impl(std::shared_ptr<OpenMap> map, bool is_first, const Camera& cam,
       const LocalizerOptions& localizer_options)
      : open_map(std::move(map)),
        is_first_of_map(is_first),
        bundle(open_map->bundle),
        levers(ResolveLevers(localizer_options.preset, localizer_options.add)),
        retrieval(open_map->retrieval),
        stations(*bundle),
        places(PlaceGraphOf(*bundle), {}),
        camera(cam),
        options(localizer_options),
        pose_options(PoseOptionsFor(levers, *bundle, cam, options.seed)),
        coarse_options(CoarseOptions(pose_options)),
        paper_options(PaperOptionsFor(levers, cam, options.seed)) {
    if (!levers.tracking) matcher.emplace(bundle, cam, paper_options);
    if (options.num_threads > 0) {
      thread_limit =
          std::make_unique<tbb::global_control>(tbb::global_control::max_allowed_parallelism,
                                                static_cast<std::size_t>(options.num_threads));
    }
    const Manifest& manifest = bundle->manifest();
    identity.name = manifest.name;
    identity.id = bundle->id();
    identity.build = manifest.build;
    identity.is_signed = bundle->release().has_value();
    identity.num_panoramas = bundle->panoramas().size();
    identity.num_views = bundle->views().size();
  }

  static constexpr int kShortPause = 4, kLongPause = 8;
  enum class Detail { kFull, kCoarse };
  FrameFeatures ExtractFeatures(const GrayImage& image, Detail detail, StageLatency* latency) const;
  BagOfWords MakeBag(const GrayImage& image, const FrameFeatures& features,
                     StageLatency* latency) const;
  [[nodiscard]] std::vector<Rigid3> Predict(std::int64_t now_ns, const LocalFrame& local) const;
  [[nodiscard]] LocalFrame LocalOfSeeds() const;  // where history has seeds
  [[nodiscard]] bool CanTrack() const;
  // The pose that the predictions lead to.
  PoseOutcome Follow(const FrameFeatures& features, Detail detail, const LocalFrame& local,
                     FrameResult* result);
  bool Track(const FrameFeatures& features, FrameResult* result);
  // The same at half the frame's size, where the last frames were sure so.
  bool TrackCoarse(const GrayImage& image, FrameResult* result);
  // Carries on from what the last frames saw, where the map alone does not. kSure: a degraded pose
  // is not taken, as there is a better one.
  enum class Bridging { kAny, kSure };
  bool Bridge(const FrameFeatures& features, Bridging bridging, FrameResult* result);
  [[nodiscard]] PoseContext Context(const FrameFeatures& features, const LocalFrame& local,
                                    Detail detail = Detail::kFull) const;
  // Panoramas that hold most of the belief; empty where it is spread too far.
  [[nodiscard]] std::vector<std::uint32_t> Window() const;
  RetrievalResult Retrieve(const RetrievalQuery& query, const std::vector<std::uint32_t>& window,
                           FrameResult* result);
  PoseOutcome Solve(const FrameFeatures& features, const RetrievalResult& retrieved,
                    LocalFrame* local, StageLatency* latency) const;
  // Trusts a find that is not sure where the last ones confirm it.
  void Confirm(const LocalFrame& local, std::int64_t now_ns, PoseOutcome* outcome);
  // Takes a trusted outcome as the frame's answer; false where it is not trusted.
  bool Accept(const FrameFeatures& features, const PoseOutcome& outcome, const LocalFrame& local,
              FrameResult* result);
  // Whether the map has no second of what the frame shows, as far as the run of frames tells.
  [[nodiscard]] bool IsDistinct(const FrameFeatures& features, const PoseOutcome& outcome,
                                const LocalFrame& local, FrameResult* result);
  // Poses of the views elsewhere that the frame's landmarks speak for, most votes first.
  [[nodiscard]] std::vector<Rigid3> PlacesElsewhere(const FrameFeatures& features,
                                                    const Rigid3& cam_from_local,
                                                    const LocalFrame& local) const;
  // A fix of a camera whose calibration is doubted is degraded.
  void DegradeMiscalibrated(FrameResult* result) const;
  // Keeps a pose for the next frames.
  void Remember(const FrameFeatures& features, const PoseOutcome& outcome, bool is_distinct,
                const FrameResult* result);
  // Tiles come and go with the vehicle.
  void FollowTiles(const FrameResult& result);
  void Advance(std::int64_t now_ns);
  // Whether the frame's time is up; its reason says so then. No tile is looked at meanwhile, so the
  // map's first localizer may have its turn.
  bool IsLate(FrameResult* result);
  void Run(const GrayImage& frame, FrameResult* result);  // result->timestamp_ns is set
  void RunUntracked(const GrayImage& image, const FrameFeatures& features, FrameResult* result);
  void Fill(const PoseOutcome& outcome, const LocalFrame& local, FrameResult* result) const;

  std::shared_ptr<OpenMap> open_map;
  bool is_first_of_map;
  std::unique_lock<FairMutex> turn;  // while a frame is worked on and memory is bounded
  std::shared_ptr<const MapBundle> bundle;
  Levers levers;
  const Retrieval& retrieval;
  StationGrid stations;
  PlaceFilter places;
  std::int64_t last_frame_ns = 0;
  bool has_last_frame = false;
  Camera camera;
  LocalizerOptions options;
  PoseOptions pose_options;
  PoseOptions
      coarse_options;  // of what is looked at at half its size: all of it is, where in doubt
  PaperOptions paper_options;
  std::optional<PaperMatcher> matcher;        // where nothing is tracked
  std::vector<std::uint32_t> last_retrieved;  // views around which it looks next
  BundleIdentity identity;
  std::unique_ptr<tbb::global_control> thread_limit;
  FixHistory history;
  std::optional<Eigen::Vector3d> last_in_map;  // of the last pose, for the tiles
  CalibrationWatch calibration;
  RivalWatch rivals;
  FindWatch finds;
  // Frames until half the size is tried again, and after the next time that it leaves doubt:
  // streets that show little are long.
  int coarse_pause = 0, next_coarse_pause = kShortPause;
  bool last_is_distinct = false;  // of the last pose in history
  PastFrames past;
  RecentFrames recent;
  TimeIsUp time_is_up;       // of the frame at work
  std::vector<float> votes;  // of the frame at work, once the whole map was searched for it
};

}  // namespace panofix
