#pragma once
// Features of one panorama's rectilinear views, with 3-D points from its depth planes.

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "builder/ingest/depth_map.h"
#include "builder/ingest/panorama_set.h"
#include "builder/rectify/rectifier.h"
#include "common/features/features.h"
#include "common/map/manifest.h"

namespace panofix {

// A surface point seen at a keypoint.
struct SurfacePoint {
  Eigen::Vector3f point_in_pano = Eigen::Vector3f::Zero();  // metres, in the source's frame
  float range_sigma_m = 0;  // 1-sigma error along the panorama's ray; 0 = no surface here, no point
  std::uint8_t surface_idx = 0;  // plane of the depth map; 0 = a raster's
  std::uint8_t source_idx = 0;   // whose image and depth it is: into the sources
};

struct ViewFeatureSet {
  FeatureSet sift;                   // all: those without a point still serve retrieval
  std::vector<SurfacePoint> points;  // one a SIFT feature
  FeatureSet mser;
};

struct PanoramaFeatures {
  std::vector<std::string> sources;  // ids of the panoramas that points refer to; itself first
  bool has_depth = false;
  std::vector<DepthPlane> planes;     // by surface index; empty for a raster
  std::string depth_fault;            // why not, where a depth file is given but unusable
  std::vector<ViewFeatureSet> views;  // one a direction of the rectifier, station by station
};

struct ExtractOptions {
  FeatureOptions features;
  MapErrors errors;
  double max_range_m = 80;  // points beyond hold no position
  double max_incidence_deg =
      84;              // of the ray to the surface normal; beyond, a plane's error explodes
  void Check() const;  // throws std::invalid_argument
};

// The point under a view's pixel with its range sigma: plane distance and direction errors, relief
// off the plane, and the step at a depth edge within one depth pixel. nullopt: no surface, too far,
// oblique.
[[nodiscard]] std::optional<SurfacePoint> PointOnSurface(const DepthMap& depth,
                                                         const Eigen::Vector3d& ray_in_pano,
                                                         const ExtractOptions& options);

// What extraction needs of a panorama's files beside its image. `fault` says why a stated depth is
// unusable; the mask is empty where none is stated.
[[nodiscard]] Result<GrayImage> ReadMask(const PanoramaRecord& record);
[[nodiscard]] std::optional<DepthMap> ReadUsableDepth(const PanoramaRecord& record,
                                                      std::string* fault);

// Decodes, cuts, equalises and describes one panorama. Fails (to be set aside) on an unreadable
// image or one that is not 2:1; an unusable depth file leaves a panorama without points.
// Thread-safe.
[[nodiscard]] Result<PanoramaFeatures> ExtractPanorama(const PanoramaRecord& record,
                                                       const Rectifier& rectifier,
                                                       const ExtractOptions& options);

// One file a panorama, written atomically: what an interrupted build resumes from.
void WritePanoramaFeatures(const std::filesystem::path& path, const PanoramaFeatures& features);
[[nodiscard]] Result<PanoramaFeatures> ReadPanoramaFeatures(const std::filesystem::path& path);

}  // namespace panofix
