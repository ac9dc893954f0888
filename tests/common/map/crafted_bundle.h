#pragma once
// A small bundle as its arrays, written file by file as schemas/bundle.md says and independently of
// the builder, so that tests can put anything in it. Hashes and sizes are always right.

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "common/map/map_bundle.h"

namespace panofix {

struct CraftedTile {
  std::string path;  // of the part
  std::vector<std::string> panorama_ids;
  std::vector<std::uint32_t> view_offsets{0}, plane_offsets{0};
  std::vector<float> planes, keypoints, points;  // N x 4
  std::vector<std::uint8_t> surfaces, descriptors;
  std::vector<std::uint32_t> bag_offsets{0}, words;
  std::vector<float> weights;
  // One feature at the end, of the view that is being filled.
  void AddFeature(const Keypoint& keypoint, const Eigen::Vector3d& point_in_pano,
                  double range_sigma_m, std::span<const std::uint8_t> descriptor,
                  std::uint8_t surface_idx = 0);
  // Ends the view that is being filled; `bag` belongs to it.
  void EndView(const BagOfWords& bag);
  // Ends a panorama; its depth planes (n, d), by surface index.
  void EndPanorama(const std::vector<Eigen::Vector4d>& panorama_planes);
};

struct CraftedBundle {
  Manifest manifest;  // parts and counts are filled in by Write
  std::vector<std::string> ids;
  std::vector<double> geodetic, positions, rotations, scales, directions;
  std::vector<std::uint8_t> has_depth;
  std::vector<std::uint32_t> link_offsets{0}, links;
  std::vector<std::uint32_t> similar_offsets{0}, similar;
  Vocabulary vocabulary;
  std::vector<CraftedTile> tiles;
  // Any further files, path and content.
  std::vector<std::pair<std::string, std::string>> extra_parts;

  void AddPanorama(const std::string& id, const Rigid3& map_from_pano,
                   const std::vector<std::uint32_t>& panorama_links, bool depth = true);
  void Write(const std::filesystem::path& folder) const;
};

// Four panoramas a, b, c, d in a row, 10 m apart, linked; two tiles of two; two views a panorama
// with 0 to 5 features each, of the planes of index 1 and 2; a vocabulary of 4 SIFT and 2 MSER
// words.
[[nodiscard]] CraftedBundle SmallBundle();

// Writes the manifest's hash file anew, after a test has changed the manifest.
void SealManifest(const std::filesystem::path& folder);

}  // namespace panofix
