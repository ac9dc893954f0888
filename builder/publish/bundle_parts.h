#pragma once
// The HDF5 parts of a map bundle, each written atomically (schemas/bundle.md).

#include <filesystem>
#include <string>
#include <vector>

#include "builder/landmarks/landmark_layer.h"
#include "builder/rectify/rectifier.h"
#include "builder/similarity/similarity_index.h"
#include "common/map/manifest.h"
#include "common/map/map_bundle.h"
#include "common/vocabulary/vocabulary.h"

namespace panofix {

// One tile's part of the map: the landmarks that the views of its panoramas show.
struct BundleTile {
  std::vector<Landmark> landmarks;  // `panorama` and `views` are the bundle's; by anchor, ascending
  // Refined surfaces of each anchor, in the order of anchors' first landmarks.
  struct Anchor {
    std::uint32_t panorama_idx = 0;
    std::vector<DepthPlane> planes;
    std::vector<float> distance_sigma_share, normal_sigma_rad;
  };
  std::vector<Anchor> anchors;   // ascending; of every landmark
  std::vector<BagOfWords> bags;  // one a view of the tile's stations
  // JPEGs of the panoramas' own views, in order; empty = not kept.
  std::vector<std::vector<std::uint8_t>> view_images;
};

// Everything below is in one panorama order: sorted by (tile, id).
struct BundleContent {
  Manifest manifest;  // parts and counts come once the parts are written
  std::vector<MapPanorama> panoramas;
  std::vector<std::string> tile_of_panorama;  // quadkeys
  std::vector<MapStation> stations;           // by panorama, each panorama itself first
  std::vector<ViewDirection> directions;      // of every station's views
  Vocabulary vocabulary;       // as it comes back from its part: packing must not change a word
  SimilarityIndex similarity;  // a row a panorama's view, in view indices of the bundle
  bool pack_descriptors = true;
};

// All throw Error; std::logic_error where the content contradicts itself.
void WriteVocabulary(const std::filesystem::path& path, const Vocabulary& vocabulary, bool pack);
void WriteGraph(const std::filesystem::path& path, const BundleContent& content);
// The part of panoramas [begin, end), which share a tile.
void WriteTile(const std::filesystem::path& path, const BundleContent& content, std::size_t begin,
               std::size_t end, const BundleTile& tile);
void WriteViewImages(const std::filesystem::path& path, const BundleContent& content,
                     std::size_t begin, std::size_t end, const BundleTile& tile);

}  // namespace panofix
