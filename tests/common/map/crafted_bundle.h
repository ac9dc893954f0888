#pragma once
// A small bundle as its arrays, written file by file as schemas/bundle.md says and independently of
// the builder, so that tests can put anything in it. Hashes and sizes are always right.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "common/map/map_bundle.h"

namespace panofix {

struct CraftedTile {
  std::string path;  // of the part
  std::vector<std::string> panorama_ids, anchor_ids;
  std::vector<std::uint32_t> anchor_offsets{0}, plane_offsets{0};
  std::vector<float> planes;  // N x 6
  std::vector<float> points;  // N x 3
  std::vector<std::uint8_t> codes, descriptors;
  int code_cols = 6, descriptor_cols = kDescriptorSize;
  std::optional<std::vector<std::uint32_t>> landmark_words;  // none: as before format 2.2
  std::vector<std::uint32_t> view_offsets{0}, view_landmarks;
  std::vector<std::uint32_t> bag_offsets{0}, words;
  std::vector<std::uint8_t> weights;
  // One landmark at the end, of the anchor that is being filled; returns its number in the tile.
  // Its panorama_idx is of no meaning. Descriptors of a tile are all whole or all packed.
  std::uint32_t AddLandmark(const MapLandmark& landmark, std::span<const std::uint8_t> descriptor);
  // Ends an anchor; its planes by surface index.
  void EndAnchor(const std::string& id, const std::vector<MapSurface>& surfaces);
  // Ends a view of the tile's panoramas' stations.
  void EndView(const std::vector<std::uint32_t>& landmarks, const BagOfWords& bag);
};

// Pictures of panoramas' own views.
struct CraftedImages {
  std::string path;
  std::vector<std::string> panorama_ids;
  std::vector<std::uint32_t> offsets{0};
  std::vector<std::uint8_t> jpeg;
};

struct CraftedBundle {
  Manifest manifest;  // parts and counts are filled in by Write
  std::vector<std::string> ids;
  std::vector<double> geodetic, positions, rotations, scales, directions;
  std::vector<std::uint8_t> has_depth, is_flagged;
  std::vector<std::uint32_t> station_panoramas;
  std::vector<float> station_positions;  // N x 3
  std::vector<std::uint32_t> link_offsets{0}, links;
  std::vector<std::uint32_t> similar_offsets{0}, similar;
  Vocabulary vocabulary;
  std::vector<CraftedTile> tiles;
  std::vector<CraftedImages> images;
  // Any further files, path and content.
  std::vector<std::pair<std::string, std::string>> extra_parts;

  // With the station that it is itself.
  void AddPanorama(const std::string& id, const Rigid3& map_from_pano,
                   const std::vector<std::uint32_t>& panorama_links, bool depth = true);
  // A virtual one of the last panorama.
  void AddStation(const Eigen::Vector3f& position_in_pano);
  // The words of all tiles' landmarks, from their descriptors.
  void AddWords();
  void Write(const std::filesystem::path& folder) const;
};

// Four panoramas a, b, c, d in a row along y, 10 m apart, linked; b has a virtual station 4 m on;
// two tiles of two panoramas; two views a station, ten in all; a vocabulary of 4 SIFT and 2 MSER
// words, landmarks without theirs. Panorama number p anchors 2 + p landmarks at (100 p + i, 1, 2) m
// on plane 1 + i % 2, the first tile's in tile 0, the others in tile 1, which b anchors one of too.
// View `slot` of a tile shows its landmarks n where (n + slot) % 3 != 0.
[[nodiscard]] CraftedBundle SmallBundle();

// Writes the manifest's hash file anew, after a test has changed the manifest.
void SealManifest(const std::filesystem::path& folder);

}  // namespace panofix
