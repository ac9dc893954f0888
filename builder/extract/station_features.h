#pragma once
// Features of views rendered at virtual stations.

#include <string>
#include <vector>

#include "builder/augment/station_planner.h"
#include "builder/augment/view_renderer.h"
#include "builder/extract/panorama_features.h"

namespace panofix {

// A panorama that the stations are rendered from.
struct StationSource {
  std::string id;
  std::shared_ptr<const RenderSource> content;
  Rigid3 owner_from_source;  // pano frame to the owner's pano frame, metres
};

struct StationExtractOptions {
  ExtractOptions extract;
  RenderOptions render;
  int max_sift = 1200;         // strongest looked at a view
  double max_distance_m = 25;  // of a source from the station
  int max_sources = 4;         // nearest ones a station is rendered from
  double min_coverage = 0.05;  // of a view, below which nothing is looked for
  void Check() const;          // throws std::invalid_argument
};

// Renders the views of `stations` (one panorama's, in `directions`), station by station, and keeps
// the features that lie whole on known surfaces. Points are in their sources' frames, `sources` in
// the order given. Thread-safe.
[[nodiscard]] PanoramaFeatures ExtractStations(const std::vector<Station>& stations,
                                               const std::vector<StationSource>& sources,
                                               const Camera& view_camera,
                                               const std::vector<ViewDirection>& directions,
                                               const StationExtractOptions& options);

}  // namespace panofix
