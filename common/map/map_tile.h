#pragma once
// One tile of a bundle: its views' landmarks, descriptors, planes and bags of words.

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "common/features/features.h"
#include "common/io/hdf5_file.h"
#include "common/vocabulary/vocabulary.h"

namespace panofix {

// A surface point that views of the map show.
struct MapLandmark {
  std::uint32_t panorama_idx = 0;                           // its anchor
  Eigen::Vector3d point_in_pano = Eigen::Vector3d::Zero();  // metres, in the anchor's frame
  double range_sigma_m = 0;  // 1-sigma along the anchor's ray, shared plane error included
  double point_sigma_m = 0;  // and across it
  int surface_idx = 0;       // depth plane whose error it shares; 0 = errors of its own only
  double size_m = 0;         // of the described region, across the line of sight
  double angle_deg = 0;      // of the keypoint in a level view
  int num_panoramas = 1;     // that saw it independently
};

// A depth plane after refinement.
struct MapSurface {
  Eigen::Vector3d normal_in_pano = Eigen::Vector3d::Zero();  // unit; zero = not known
  double distance_sigma_share = 0;                           // 1-sigma error, relative
  double normal_sigma_rad = 0;
};

class MapTile {
 public:
  // `panorama_idx` names a panorama's index by its id. kBadData where arrays disagree or an index
  // points outside its array.
  [[nodiscard]] static Result<MapTile> Load(
      const Hdf5Reader& file, const std::unordered_map<std::string, std::uint32_t>& panorama_idx,
      const Vocabulary& vocabulary);

  // Stands for a tile that is lost: views without landmarks or words.
  [[nodiscard]] static MapTile Blank(std::size_t num_views);

  // Panoramas whose stations' views are here, in the tile's order.
  [[nodiscard]] const std::vector<std::uint32_t>& panoramas() const { return panoramas_; }
  [[nodiscard]] std::size_t num_views() const { return view_offsets_.values.size() - 1; }
  [[nodiscard]] std::size_t num_landmarks() const { return static_cast<std::size_t>(points_.rows); }
  // Landmarks of view `slot` of this tile, by their number in it.
  [[nodiscard]] std::span<const std::uint32_t> LandmarksOf(std::size_t slot) const {
    return view_landmarks_.values.subspan(
        view_offsets_.values[slot], view_offsets_.values[slot + 1] - view_offsets_.values[slot]);
  }
  // Of a number beyond the landmarks (a tile that was lost on the way): one at the anchor's centre,
  // and zeros.
  [[nodiscard]] MapLandmark Landmark(std::size_t i) const;
  void Descriptor(std::size_t i, std::uint8_t* descriptor) const;  // 128 bytes
  // Its orientation as it is stored; REQUIRES i < num_landmarks().
  [[nodiscard]] std::uint8_t AngleCode(std::size_t i) const;
  // Has the processor fetch what Descriptor will read; same REQUIRES.
  void PrefetchDescriptor(std::size_t i) const;
  // Panoramas that landmarks belong to; those of the a-th are [anchor_offsets()[a],
  // anchor_offsets()[a + 1]). Without a landmark both may be empty.
  [[nodiscard]] const std::vector<std::uint32_t>& anchors() const { return anchors_; }
  [[nodiscard]] std::span<const std::uint32_t> anchor_offsets() const {
    return anchor_offsets_.values;
  }
  // SIFT word of each landmark; empty where the bundle does not keep them (before format 2.2).
  [[nodiscard]] std::span<const std::uint32_t> words() const { return words_.values; }
  // The same from the descriptors, with the bundle's tree: costly.
  [[nodiscard]] std::vector<std::uint32_t> DeriveWords(const VocabularyTree& sift) const;
  [[nodiscard]] BagOfWords Bag(std::size_t slot) const;
  // Surfaces of the panoramas that anchor landmarks here.
  [[nodiscard]] MapSurface Surface(std::uint32_t panorama_idx, int surface_idx) const;

 private:
  Status LoadLandmarks(const Hdf5Reader& file);
  Status LoadWords(const Hdf5Reader& file, std::uint32_t num_sift_words);
  Status LoadBags(const Hdf5Reader& file, std::uint32_t num_words);
  Status LoadSurfaces(const Hdf5Reader& file);

  std::vector<std::uint32_t> panoramas_, anchors_;
  MappedArray<std::uint32_t> anchor_offsets_, view_offsets_, view_landmarks_;
  MappedArray<float> points_;
  MappedArray<std::uint8_t> codes_, descriptors_;  // codes: N x 6
  bool is_packed_ = true;
  MappedArray<std::uint32_t> words_;
  MappedArray<std::uint32_t> bag_offsets_, bag_words_;
  MappedArray<std::uint8_t> bag_weights_;
  std::unordered_map<std::uint32_t, std::vector<MapSurface>> surfaces_;  // by anchor
};

}  // namespace panofix
