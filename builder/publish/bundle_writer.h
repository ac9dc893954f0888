#pragma once
// Writes a map bundle: parts into a staging folder, manifest last, one rename to publish.

#include <filesystem>
#include <string>
#include <vector>

#include "builder/rectify/rectifier.h"
#include "builder/similarity/similarity_index.h"
#include "common/map/manifest.h"
#include "common/map/map_bundle.h"
#include "common/vocabulary/vocabulary.h"

namespace panofix {

// The features of one view that go on the map.
struct BundleView {
  std::vector<float> keypoints;           // N x 4: x, y, size (px), angle (deg)
  std::vector<float> points;              // N x 4: x, y, z, range sigma (m), pano frame
  std::vector<std::uint8_t> surfaces;     // N: plane of the panorama's depth map
  std::vector<std::uint8_t> descriptors;  // N x 128
  BagOfWords bag;
};

// One panorama's part of a tile.
struct BundlePanorama {
  std::vector<float>
      planes;  // M x 4: n . X = d in the pano frame, by surface index; empty for a raster
  std::vector<BundleView> views;
};

// Everything below is in one panorama order: sorted by (tile, id).
struct BundleContent {
  Manifest manifest;  // parts and counts are filled in by the writer
  std::vector<MapPanorama> panoramas;
  std::vector<std::string> tile_of_panorama;  // quadkeys
  std::vector<ViewDirection> directions;      // of every panorama's views
  Vocabulary vocabulary;
  SimilarityIndex similarity;
};

// Called once a panorama, tile by tile, so that one tile's features are in memory at a time.
using FeaturesOfPanorama = std::function<BundlePanorama(std::size_t panorama_idx)>;

// Writes the bundle next to `target` and publishes it by one rename; on failure or Ctrl-C the
// staging folder is removed and an existing bundle stays. Returns the manifest as written. Throws
// Error.
Manifest WriteBundle(const std::filesystem::path& target, const BundleContent& content,
                     const FeaturesOfPanorama& features_of_panorama);

}  // namespace panofix
