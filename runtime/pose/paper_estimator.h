#pragma once
// The published estimator to the letter (L. Yu, C. Joly, G. Bresson, F. Moutarde, "Monocular Urban
// Localization using Street View", ICARCV 2016, section III-C): what the default one is compared
// with.

#include <memory>
#include <span>
#include <vector>

#include "common/estimate/pnp.h"
#include "common/estimate/refine.h"
#include "common/features/kvld.h"
#include "common/map/map_bundle.h"
#include "runtime/pose/frame_matches.h"
#include "runtime/pose/pose_options.h"
#include "runtime/pose/view_image_cache.h"

namespace panofix {

struct PaperOptions {
  MatchOptions match{.max_ratio = 0.8, .mutual = false};  // Lowe's ratio alone
  bool use_kvld = true;  // false: matches as they come, no images needed
  KvldOptions kvld;
  std::size_t max_cached_views = 32;  // whose gradients are kept
  RansacOptions ransac;               // a view's; focal length and seed are set by the caller
  RefineOptions refine;               // Eqs. 5-6
  BundleOptions bundle;
  int min_inliers = 13;     // of a view's pose, and of the frame's: "larger than 12"
  bool use_sigmas = false;  // false: every match counts as one of 1 px error on an exact map
  PaperOptions();           // EPnP in RANSAC, 3 px, no local optimisation
  void Check() const;       // throws std::invalid_argument naming field, value and rule
};

// Feature matching: SIFT by ratio, then kVLD on the images. Thread-safe.
class PaperMatcher {
 public:
  // Throws std::invalid_argument where `options` ask for kVLD and the map keeps no images.
  PaperMatcher(std::shared_ptr<const MapBundle> bundle, const Camera& camera,
               const PaperOptions& options);
  // Matches of each of `views` in the local frame. `image` is the frame as its features were found
  // in it. A view whose image cannot be used has none, with a warning. Views in parallel.
  [[nodiscard]] std::vector<ViewMatches> Match(const FrameFeatures& frame, const GrayImage& image,
                                               std::span<const std::uint32_t> views,
                                               const LocalFrame& local);

 private:
  [[nodiscard]] ViewMatches KeepConsistent(const ViewMatches& matches, const FrameFeatures& frame,
                                           const GradientPyramid& image, const LocalFrame& local);
  const std::shared_ptr<const MapBundle> bundle_;
  const Camera camera_;
  const PaperOptions options_;
  ViewImageCache cache_;
};

// Where the landmarks of `ids` lie in a view's picture, as keypoints: exact for the panorama's own
// features, not finite where a landmark lies behind the view.
[[nodiscard]] std::vector<Keypoint> KeypointsInView(const MapBundle& bundle, std::uint32_t view_idx,
                                                    std::span<const std::uint32_t> ids,
                                                    const LocalFrame& local);

// The matches as of 1 px error on an exact map, which is what the paper takes them for.
[[nodiscard]] ViewMatches WithoutSigmas(ViewMatches matches, double focal_px);

// EPnP-RANSAC and Tukey refinement for each view; the poses that enough inliers carry and those
// inliers in one local bundle adjustment, which starts at the pose of most inliers. Trusted with
// `min_inliers` distinct keypoints within RANSAC's threshold of the final pose. Deterministic;
// never throws on data.
[[nodiscard]] PoseOutcome EstimatePaperPose(std::span<const ViewMatches> views,
                                            const MapErrors& errors, const PaperOptions& options);

}  // namespace panofix
