#pragma once
// The runtime's public door: camera frames in, georeferenced poses or reasons out.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/camera/camera.h"
#include "common/drive/poses_csv.h"
#include "common/drive/run_log.h"
#include "common/geo/map_frame.h"
#include "common/image/gray_image.h"
#include "common/sign/key_ring.h"

namespace panofix {

struct LocalizerOptions {
  std::string preset = "default";  // "default", or "paper": the published method
  std::vector<std::string> add;    // levers beside the preset's, by name (levers.h)
  int num_threads = 0;             // 0 = all cores
  std::uint64_t seed = 1;          // of the robust search; same frames, same poses
  // What this process may take of memory, kept by dropping tiles that are far away; 0 = no bound.
  // No pose depends on it, a search in the whole map takes longer.
  std::uint64_t max_memory_bytes = 0;
  bool with_sight = false;  // answers come with a FrameSight, for a person to look at
  KeyRing trusted_keys;     // the bundle must be signed with one; empty = it may be unsigned
  void Check() const;       // throws std::invalid_argument
};

struct FramePose {
  Geodetic position;
  Attitude attitude;
  Eigen::Quaterniond enu_from_cam;
  Eigen::Vector3d position_in_map;  // of the camera's centre
  Eigen::Quaterniond map_from_cam;
  // ROS order x y z rotX rotY rotZ, row-major when written; map axes, metres and radians.
  Eigen::Matrix<double, 6, 6> covariance_in_map;
};

struct FrameSight;

struct FrameResult {
  std::int64_t timestamp_ns = 0;
  FixStatus status = FixStatus::kNoFix;
  std::string reason;             // snake_case word, e.g. "too_few_inliers"; empty on a fix
  std::optional<FramePose> pose;  // absent exactly where status is kNoFix
  int num_inliers = 0, num_views = 0;
  std::string best_panorama;
  StageLatency latency;
  std::int64_t num_compared = 0;  // database views that the retrieval looked at
  std::int64_t num_database = 0;  // views in the map
  bool map_is_unsigned = true;    // no signature of the bundle was verified
  // runtime/localizer/frame_sight.h; absent without a pose, where the map alone did not give it,
  // and where it was not asked for.
  std::shared_ptr<const FrameSight> sight;
};

// What a bundle says of itself, for messages and logs.
struct BundleIdentity {
  std::string name;
  std::string id;  // SHA-256 of the manifest, hex
  std::int64_t build = 0;
  bool is_signed = false;
  std::size_t num_panoramas = 0, num_views = 0;
};

class MapBundle;
struct TileMemory;

// Asked between the steps of a frame, at the same points for the same frames: true ends the work.
using TimeIsUp = std::function<bool()>;

// One localizer serves one camera: it remembers where the last frames were. Not thread-safe; no
// exception leaves it. Others over the same open map may work in other threads.
class Localizer {
 public:
  // Verifies versions and hashes, then maps the bundle read-only.
  [[nodiscard]] static Result<std::unique_ptr<Localizer>> Open(const std::filesystem::path& bundle,
                                                               const Camera& camera,
                                                               const LocalizerOptions& options);
  // One more over the same open map and camera, as after Open. It adds little memory, and its
  // frames do not move the tiles that stay. Where memory is bounded the two take turns: this one's
  // frame waits for a step of the other's, the other's for a frame of this one's.
  [[nodiscard]] Result<std::unique_ptr<Localizer>> Another() const;
  // Camera that the bundle's views were cut for: the default where none is given.
  [[nodiscard]] static Result<Camera> ReadBundleCamera(const std::filesystem::path& bundle);
  ~Localizer();
  Localizer(const Localizer&) = delete;
  Localizer& operator=(const Localizer&) = delete;

  // Never fails: a frame of another size than the camera, or an empty one, is kNoFix with its
  // reason; so is one whose time was up before there was a pose ("deadline").
  [[nodiscard]] FrameResult Localize(std::int64_t timestamp_ns, const GrayImage& frame,
                                     const TimeIsUp& time_is_up = {});
  // A frame that could not be decoded still gets its row.
  [[nodiscard]] FrameResult Undecodable(std::int64_t timestamp_ns) const;
  [[nodiscard]] const BundleIdentity& bundle() const;
  // As after Open: the next frame may be anywhere.
  void Forget();
  [[nodiscard]] const Camera& camera() const;
  [[nodiscard]] const MapBundle& map() const;
  [[nodiscard]] TileMemory memory() const;  // runtime/retrieval/tile_indices.h

 private:
  struct Impl;
  explicit Localizer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

// One standard deviation of a pose along local east, north, up and of its heading, from its
// covariance (turned from the map's axes by the meridian convergence).
struct PoseSigmas {
  double east_m = 0, north_m = 0, up_m = 0, heading_deg = 0;
};
[[nodiscard]] PoseSigmas SigmasOf(const FramePose& pose);

// The row of poses.csv, and the entry of a run log, that a result stands for.
[[nodiscard]] PoseRow ToPoseRow(const FrameResult& result);
[[nodiscard]] RunLogEntry ToRunLogEntry(const FrameResult& result);

}  // namespace panofix
