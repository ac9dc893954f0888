#pragma once
// All that a running service counts, in one place: for the log, for Prometheus, for the live page.

#include <array>
#include <chrono>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "runtime/localizer/frame_sight.h"
#include "runtime/localizer/localizer.h"
#include "runtime/monitor/latency_histogram.h"
#include "runtime/monitor/lazy_bytes.h"

namespace panofix {

// What the feed's receiver counted since the start.
struct FeedCounts {
  std::int64_t frames = 0;        // that arrived
  std::int64_t replaced = 0;      // of these: by a newer one before they were taken
  std::int64_t rate_limited = 0;  // left out because they came faster than allowed
  std::int64_t calibrations = 0;
  std::int64_t malformed = 0, wrong_topic = 0;
  std::int64_t connects = 0, disconnects = 0;
  std::int64_t denied = 0;  // peers that were turned away: no key, or one that is not listed
};

// The map in use, as far as a watcher is concerned.
struct MapFacts {
  BundleIdentity bundle;
  std::int64_t created_s = 0;  // by its signed statement, seconds since 1970; 0 = not known
  std::int64_t num_tiles = 0;
  // Panoramas, and links between them by index: the route that the map covers.
  std::vector<Geodetic> panoramas;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> links;
};

enum class ServiceStage {
  kWait,  // from the frame's arrival to the start of work
  kDecode,
  kPreprocess,
  kFeatures,
  kRetrieval,
  kMatching,
  kPose,
  kTotal,  // from the frame's arrival to its answer
};
inline constexpr std::size_t kNumServiceStages = 8;
[[nodiscard]] const char* ServiceStageName(ServiceStage stage);

// One answer as the live page shows it.
struct TrailPoint {
  std::int64_t number = 0;  // 1, 2, 3, … since the start
  std::int64_t timestamp_ns = 0;
  FixStatus status = FixStatus::kNoFix;
  std::string reason;
  std::optional<Geodetic> position;
  double heading_deg = 0;
  // The horizontal one-sigma ellipse: half axes, and the clockwise turn of the long one from north.
  double sigma_long_m = 0, sigma_short_m = 0, sigma_turn_deg = 0;
  int num_inliers = 0;
  std::string best_panorama;
  std::array<double, kNumServiceStages> stages_ms{};
};

// The newest frame, for a browser, and what its answer rests on.
struct FramePicture {
  std::shared_ptr<const void> owner;    // keeps the bytes
  std::span<const std::uint8_t> bytes;  // as it came
  std::shared_ptr<LazyBytes> preview;   // in place of them where a browser cannot show those
  std::string content_type;
  std::int64_t timestamp_ns = 0;
  std::shared_ptr<const FrameSight> sight;  // may be absent
};

struct MonitorSnapshot {
  double uptime_s = 0;
  FeedCounts feed;
  std::map<std::pair<FixStatus, std::string>, std::int64_t> answers;  // by status and reason
  std::int64_t num_answers = 0, num_fixes = 0, num_refused = 0, num_undecodable = 0;
  std::int64_t num_camera_unknown = 0;      // frames left out while no calibration was known
  std::int64_t num_rival_calibrations = 0;  // passed over: another is in use, and comes as well
  std::int64_t num_requests = 0, num_requests_refused = 0, num_denied_users = 0;
  std::int64_t num_swaps = 0, num_failed_swaps = 0;
  std::int64_t num_recorded = 0, num_not_recorded = 0;
  std::array<LatencyHistogram, kNumServiceStages> latency;
  BundleIdentity bundle;
  std::int64_t map_created_s = 0, num_tiles = 0;
  // Tiles in memory, read since the map was opened, lost on the way; bytes that they take.
  std::int64_t num_tiles_loaded = 0, num_tile_loads = 0, num_tiles_failed = 0, tile_bytes = 0;
  // Seconds since; absent where there was none yet.
  std::optional<double> since_step_s, since_answer_s, since_fix_s;
};

// Thread-safe; every call is short. Memory is bounded: the trail keeps its newest kTrailPoints.
class ServiceMonitor {
 public:
  static constexpr std::size_t kTrailPoints = 2000;

  void SetMap(MapFacts facts);
  void SetFeed(const FeedCounts& counts);
  // The service's loop is alive; called on every turn.
  void Step();
  // `latency` of the result by stage; `wait_ms` and `decode_ms` came before.
  void AddAnswer(const FrameResult& result, double wait_ms, double decode_ms);
  // Adds to one of the snapshot's counts, e.g. Count(&MonitorSnapshot::num_refused).
  void Count(std::int64_t MonitorSnapshot::*counter, std::int64_t by = 1);
  void Set(std::int64_t MonitorSnapshot::*counter, std::int64_t value);

  [[nodiscard]] MonitorSnapshot Snapshot() const;
  // Answers after the one with this number, oldest first, at most kTrailPoints.
  [[nodiscard]] std::vector<TrailPoint> TrailAfter(std::int64_t number) const;
  void SetPicture(FramePicture picture);
  [[nodiscard]] MapFacts map() const;
  [[nodiscard]] FramePicture picture() const;

 private:
  using Clock = std::chrono::steady_clock;
  const Clock::time_point start_ = Clock::now();
  mutable std::mutex mutex_;  // guards what follows
  MonitorSnapshot counts_;
  MapFacts map_;
  FramePicture picture_;
  std::deque<TrailPoint> trail_;
  std::optional<Clock::time_point> step_, answer_, fix_;
};

}  // namespace panofix
