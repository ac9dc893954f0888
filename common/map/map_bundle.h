#pragma once
// A bundle as the runtime sees it: verified, mapped read-only, immutable.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "common/geometry/rigid3.h"
#include "common/io/hdf5_file.h"
#include "common/map/manifest.h"
#include "common/vocabulary/vocabulary.h"

namespace panofix {

struct MapPanorama {
  std::string id;
  Geodetic position;
  Rigid3 map_from_pano;              // metres; true ground lengths are map lengths / point_scale
  double point_scale = 1;            // of the map frame here
  std::vector<std::uint32_t> links;  // indices of neighbours along the road
  bool has_depth = false;            // false: its views serve retrieval only
};

struct MapView {
  std::uint32_t panorama_idx = 0;
  double yaw_deg = 0, pitch_deg = 0;  // in the pano frame
};

// Features of one view that have a 3-D point; spans stay valid as long as the bundle.
struct ViewFeatures {
  std::span<const float> keypoints;           // N x 4: x, y, size (px), angle (deg)
  std::span<const float> points_in_pano;      // N x 4: x, y, z, 1-sigma error of the range (metres)
  std::span<const std::uint8_t> surfaces;     // N: index of the depth plane; 0 = a raster's
  std::span<const std::uint8_t> descriptors;  // N x 128
  [[nodiscard]] std::size_t size() const { return keypoints.size() / 4; }
  [[nodiscard]] Eigen::Vector3d point(std::size_t i) const {
    return {double{points_in_pano[4 * i]}, double{points_in_pano[4 * i + 1]},
            double{points_in_pano[4 * i + 2]}};
  }
  [[nodiscard]] double range_sigma_m(std::size_t i) const {
    return double{points_in_pano[4 * i + 3]};
  }
};

class MapBundle {
 public:
  // Reads the manifest, checks its hash and version, then size and SHA-256 of every part on the
  // very descriptor that is mapped, and only then opens HDF5. Never writes. Any index that points
  // outside its array is kBadData.
  [[nodiscard]] static Result<std::shared_ptr<const MapBundle>> Open(
      const std::filesystem::path& folder);
  // The manifest alone, hash and version checked.
  [[nodiscard]] static Result<Manifest> ReadManifest(const std::filesystem::path& folder,
                                                     std::string* id);

  [[nodiscard]] const Manifest& manifest() const { return manifest_; }
  [[nodiscard]] const std::string& id() const { return id_; }  // SHA-256 of manifest.json
  [[nodiscard]] const MapFrame& frame() const { return frame_; }
  [[nodiscard]] const Vocabulary& vocabulary() const { return vocabulary_; }
  [[nodiscard]] const std::vector<MapPanorama>& panoramas() const { return panoramas_; }
  [[nodiscard]] const std::vector<MapView>& views() const { return views_; }
  [[nodiscard]] const std::vector<BagOfWords>& bags() const { return bags_; }  // one a view
  [[nodiscard]] ViewFeatures Features(std::size_t view_idx) const;
  // Unit normal of a panorama's depth plane, in pano; zero where the index has none (a raster).
  [[nodiscard]] Eigen::Vector3d SurfaceNormal(std::size_t panorama_idx,
                                              std::uint8_t surface_idx) const;
  // Row of D_DB x r: similar views, best first.
  [[nodiscard]] std::span<const std::uint32_t> SimilarViews(std::size_t view_idx) const;

 private:
  struct Tile {
    MappedArray<float> keypoints, points;
    MappedArray<std::uint8_t> surfaces, descriptors;
  };
  struct Slice {
    std::uint32_t tile = 0, begin = 0, end = 0;  // feature rows of a view in its tile
  };
  explicit MapBundle(Manifest manifest)
      : manifest_(std::move(manifest)), frame_(manifest_.map_frame) {}
  Status LoadPart(const BundlePart& part, int fd, const std::string& name);
  Status LoadVocabulary(const Hdf5Reader& file);
  Status LoadGraph(const Hdf5Reader& file);
  Status LoadPanoramas(const Hdf5Reader& file);
  Status LoadTile(const Hdf5Reader& file);
  Status LoadPlanes(const Hdf5Reader& file, const std::vector<std::uint32_t>& panorama_of_slot);
  Status LoadBags(const Hdf5Reader& file, const std::vector<std::uint32_t>& view_of_slot);

  Manifest manifest_;
  std::string id_;
  MapFrame frame_;
  Vocabulary vocabulary_;
  std::vector<MapPanorama> panoramas_;
  std::unordered_map<std::string, std::uint32_t> index_of_panorama_;  // by id
  std::vector<MapView> views_;
  std::vector<BagOfWords> bags_;
  std::vector<Tile> tiles_;
  std::vector<Slice> slices_;
  std::vector<std::vector<Eigen::Vector3f>> normals_;  // of each panorama's planes
  MappedArray<std::uint32_t> similar_offsets_, similar_views_;
};

}  // namespace panofix
