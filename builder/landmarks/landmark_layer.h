#pragma once
// Landmarks: what several views and panoramas saw of one surface point, as one entry of the map;
// and the panorama poses and depth planes that suit them all.

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "builder/ingest/depth_map.h"
#include "common/features/features.h"
#include "common/geometry/rigid3.h"
#include "common/map/manifest.h"

namespace panofix {

// A panorama as the layer sees it. "local" is any metric frame shared by all that are given.
struct LandmarkPanorama {
  Rigid3 local_from_pano;          // by its geotag
  bool is_fixed = false;           // belongs to another tile: helps, but is not moved
  std::vector<DepthPlane> planes;  // by surface index; empty for a raster
};

// One SIFT feature of a native or rendered view.
struct LandmarkObservation {
  std::uint32_t view = 0;         // of the map; only told apart and handed on
  std::uint32_t panorama = 0;     // whose texture and depth it is: index into the panoramas
  std::uint8_t surface_idx = 0;   // its depth plane there; 0 = a raster's
  Eigen::Vector3f point_in_pano;  // metres, in that panorama's frame, on the unrefined plane
  float range_sigma_m = 0;        // along that panorama's ray, shared plane errors included
  float size_m = 0;  // of the described region at the surface: size_px / f * distance from the view
  float angle_deg = 0;  // of the keypoint in its view
  float response = 0;
  std::span<const std::uint8_t, kDescriptorSize> descriptor;
};

struct LandmarkOptions {
  bool merge = true;   // false: every observation is a landmark of its own (the paper's)
  bool refine = true;  // joint refinement of panorama poses and planes; needs merge
  double max_merge_descriptor_distance = 220;  // RootSIFT bytes; beyond, an appearance of its own
  int max_per_view = 160;                      // landmarks kept for a view's sake; 0 = all
  double max_shift_m = 0.5;  // of a panorama by the refinement; beyond, it is flagged
  double max_turn_deg = 1.5;
  void Check() const;  // throws std::invalid_argument naming field, value and rule
};

struct Landmark {
  std::uint32_t panorama = 0;     // anchor
  Eigen::Vector3f point_in_pano;  // metres, in the anchor's frame
  float range_sigma_m = 0;        // 1-sigma along the anchor's ray, shared plane error included
  float point_sigma_m = 0;        // 1-sigma across it
  std::uint8_t surface_idx = 0;  // plane whose error it shares; 0 = triangulated, errors of its own
  float size_m = 0, angle_deg = 0;
  std::uint8_t num_panoramas = 1;  // that saw it with their own eyes
  std::array<std::uint8_t, kDescriptorSize> descriptor;
  std::vector<std::uint32_t> views;  // that show it, ascending
};

// What the joint refinement did to a panorama.
struct PanoramaRefinement {
  Rigid3 local_from_pano;
  std::vector<DepthPlane> planes;
  // 1-sigma error left, a plane: share of its distance, and its direction (radians).
  std::vector<float> distance_sigma_share, normal_sigma_rad;
  double shift_m = 0, turn_deg = 0;                      // from the geotag
  double residual_before_px = 0, residual_after_px = 0;  // median over its tracks
  int num_tracks = 0;
  bool is_flagged = false;  // the geotag cannot be reconciled with what its neighbours see
};

struct LandmarkLayer {
  std::vector<Landmark>
      landmarks;  // in an order that does not depend on that of the input's observations
  std::vector<PanoramaRefinement> panoramas;  // one a panorama given
};

// Merges observations of one surface point (same panorama and plane, near in space, alike), joins
// what several panoramas saw along known geometry into tracks, refines poses (prior: the geotag's
// sigma), planes (prior: the depth's) and points jointly (Ceres, Schur), and keeps the landmarks
// that most views can use. `focal_px` turns bearings into pixels. Deterministic for any order of
// the observations.
[[nodiscard]] LandmarkLayer BuildLandmarks(std::span<const LandmarkPanorama> panoramas,
                                           std::span<const LandmarkObservation> observations,
                                           const MapErrors& errors, double focal_px,
                                           const LandmarkOptions& options);

}  // namespace panofix
