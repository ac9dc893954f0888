#pragma once
// Everything that a build is asked for.

#include <cstdint>
#include <filesystem>
#include <string>

#include "builder/extract/station_features.h"
#include "builder/landmarks/landmark_layer.h"
#include "builder/similarity/similarity_index.h"
#include "common/map/manifest.h"

namespace panofix {

struct BuildOptions {
  std::filesystem::path panoramas;  // panoramas.geojson or .geojsonl
  std::filesystem::path camera;     // camera.yaml of the vehicle
  std::filesystem::path out;  // the bundle's folder; an existing bundle is replaced in one step
  std::filesystem::path
      work;                // intermediate files; default: OUT.work. Kept: the next build reuses it
  std::string name;        // of the bundle; default: the out folder's name
  std::int64_t build = 1;  // build number
  std::string map_frame = "tangent";  // or a known grid, e.g. EPSG:2154
  int num_views = 8;                  // rectilinear views a panorama (paper: 8)
  double view_pitch_deg = 0;          // their common pitch, up positive
  ExtractOptions extract;
  std::filesystem::path vocabulary;  // a release: vocabulary.h5 or a bundle; empty = train one
  int num_sift_words = 5000;         // vocabulary sizes (paper: 5000 + 2000)
  int num_mser_words = 2000;
  int max_words = 150;      // heaviest kept of a view's bag; 0 = all
  StationOptions stations;  // virtual ones, along the links
  RenderOptions render;     // of their views
  LandmarkOptions landmarks;
  bool pack_descriptors = true;   // four bits an entry instead of eight
  bool keep_view_images = false;  // for kVLD at run time; about 0.2 MB a view
  SimilarityOptions similarity;
  double max_set_aside_share = 0.5;  // more bad panoramas than this fail the build
  int shard_level = 15;              // quadkey level of the shards: some 800 m a side
  int num_threads = 0;               // 0 = all cores; changes no byte
  std::uint64_t seed = 1;
  void Check() const;  // throws std::invalid_argument naming field, value and rule
};

// The options that decide the bundle's bytes and do not stand elsewhere in its manifest, as JSON.
[[nodiscard]] std::string OptionsJson(const BuildOptions& options);
// All options but the paths, as JSON, and back. ParseOptions throws Error(kBadData) where one is
// missing or unknown: a plan is read by the release that wrote it.
[[nodiscard]] std::string FormatOptions(const BuildOptions& options);
[[nodiscard]] BuildOptions ParseOptions(const std::string& json);

}  // namespace panofix
