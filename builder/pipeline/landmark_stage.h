#pragma once
// The stage that turns a tile's observations into landmarks.

#include <functional>
#include <vector>

#include "builder/extract/panorama_features.h"
#include "builder/landmarks/landmark_layer.h"
#include "builder/pipeline/run_report.h"
#include "builder/publish/bundle_parts.h"

namespace panofix {

// Panoramas so near to the tile's are read too, but not moved.
inline constexpr double kLandmarkHalo_m = 45;

// What the stage reads: features of the panoramas' own views and of their virtual stations' views,
// by panorama (the latter empty where there are none).
struct LandmarkStageInput {
  std::function<PanoramaFeatures(std::size_t panorama_idx)> native, rendered;
  const BundleContent& content;
  MapErrors errors;
  Camera view_camera;
  LandmarkOptions options;
  double halo_m = kLandmarkHalo_m;
};

// The tile's panoramas [begin, end), then those of its halo, ascending: all that its landmarks
// depend on.
[[nodiscard]] std::vector<std::uint32_t> TileMembers(const std::vector<MapPanorama>& panoramas,
                                                     std::size_t begin, std::size_t end,
                                                     double halo_m);

// Landmarks that the views of panoramas [begin, end) show. The halo's observations take part, so
// that the result depends on the tile's surroundings only. Writes refined poses of the tile's own
// panoramas into `panoramas`, and what was done to them into `report`.
[[nodiscard]] BundleTile MakeLandmarkTile(const LandmarkStageInput& input, std::size_t begin,
                                          std::size_t end, std::vector<MapPanorama>* panoramas,
                                          std::vector<RefinementReport>* report);

}  // namespace panofix
