#pragma once
// What the last frames saw, as landmarks for the next: points between them, triangulated from their
// poses.

#include <cstdint>
#include <vector>

#include "common/camera/camera.h"
#include "common/map/local_frame.h"
#include "runtime/pose/landmark_set.h"
#include "runtime/pose/pose_options.h"

namespace panofix {

struct RecentOptions {
  double keyframe_step_m = 0.4;  // frames nearer to the one before replace nothing
  std::size_t max_keyframes = 10;
  double max_age_s = 30;         // parked cars drive off
  double min_baseline_m = 0.8;   // between frames that are triangulated
  double max_baseline_m = 4;     // beyond, little looks the same
  std::size_t max_partners = 3;  // of the newest keyframe
  double max_epipolar_px = 5;    // the poses are good to centimetres
  double max_reproj_error_px = 4;
  double min_parallax_rad = 0.02;
  double min_range_m = 3, max_range_m = 60;
  double pose_sigma_m = 0.03;  // of one keyframe against another: what depth inherits from it
};

// Points seen from the newest keyframe, which stands in for the panorama that vouches for them.
struct RecentPoints {
  // Without bearing; match.panorama_idx is kPanorama, levers start at the keyframe.
  std::vector<ReadyLandmark> points;
  PanoramaPrior keyframe;                    // its pose as it was known
  Rigid3 cam_from_local;                     // of the keyframe
  double unmapped_m = 0;                     // PoseOutcome::unmapped_m of the keyframe
  static constexpr int kPanorama = 1 << 30;  // no panorama of a bundle
};

// A keyframe's features and pose, kept while they may serve. Not thread-safe.
class RecentFrames {
 public:
  explicit RecentFrames(const RecentOptions& options = {}) : options_(options) {}
  // Drops what is too old at `now_ns`, and all where times run backwards.
  void Advance(std::int64_t now_ns);
  // A frame with a pose to rely on, its covariance and unmapped way those of `outcome`.
  void Add(std::int64_t now_ns, const Rigid3& map_from_cam, const PoseOutcome& outcome,
           const FrameFeatures& frame);
  void Clear() { keyframes_.clear(); }
  // Points of the newest keyframe by its older ones, in `local`. Some 10 ms a partner.
  [[nodiscard]] RecentPoints Triangulate(const Camera& camera, const LocalFrame& local,
                                         const GuidedOptions& guided) const;

 private:
  struct Keyframe {
    std::int64_t timestamp_ns;
    Rigid3 map_from_cam;
    Matrix6d covariance;
    double unmapped_m;
    FrameFeatures frame;
  };
  RecentOptions options_;
  std::vector<Keyframe> keyframes_;  // older first
};

}  // namespace panofix
