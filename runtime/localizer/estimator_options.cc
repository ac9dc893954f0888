#include "runtime/localizer/estimator_options.h"

#include <limits>

namespace panofix {
namespace {

// What is left is the paper's rule: enough inliers.
void OpenGates(int min_inliers, PoseOptions* options) {
  constexpr double kAny = std::numeric_limits<double>::infinity();
  options->min_inliers = min_inliers;
  options->min_spread = options->min_lead = options->min_clear_lead = 0;
  options->max_position_sigma_m = options->fix_position_sigma_m = kAny;
  options->max_chi2_per_dof = options->max_height_off_m = kAny;
  options->max_tilt_deg = options->max_distance_m = kAny;
}

}  // namespace

RetrievalOptions RetrievalOptionsFor(const Levers& levers, const MapBundle& bundle,
                                     std::uint64_t max_memory_bytes) {
  RetrievalOptions retrieval;
  retrieval.use_landmarks = levers.votes && bundle.manifest().features.root_sift;
  retrieval.max_memory_bytes = max_memory_bytes;
  return retrieval;
}

PaperOptions PaperOptionsFor(const Levers& levers, const Camera& camera, std::uint64_t seed) {
  PaperOptions paper;
  paper.ransac.focal_px = camera.fx_px;
  paper.ransac.seed = seed;
  paper.use_kvld = !levers.mutual;
  if (levers.mutual) paper.match = MatchOptions{};
  paper.use_sigmas = paper.refine.use_point_sigma = levers.sigmas;
  return paper;
}

PoseOptions PoseOptionsFor(const Levers& levers, const MapBundle& bundle, const Camera& camera,
                           std::uint64_t seed) {
  PoseOptions pose;
  pose.ransac.focal_px = camera.fx_px;
  pose.ransac.seed = seed;
  pose.ransac.max_reproj_error_px = 4.0;
  pose.refine.use_point_sigma = levers.sigmas;
  pose.use_guided = levers.guided && bundle.manifest().features.root_sift;
  pose.use_wide = levers.confirm;
  if (!levers.gates) OpenGates(PaperOptions{}.min_inliers, &pose);
  return pose;
}

}  // namespace panofix
