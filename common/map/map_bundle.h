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
#include "common/map/bundle_files.h"
#include "common/map/local_frame.h"
#include "common/map/manifest.h"
#include "common/map/map_tile.h"
#include "common/map/tile_cache.h"
#include "common/map/view_images.h"
#include "common/vocabulary/vocabulary.h"

namespace panofix {

struct MapPanorama {
  std::string id;
  Geodetic position;
  Rigid3 map_from_pano;              // metres; true ground lengths are map lengths / point_scale
  double point_scale = 1;            // of the map frame here
  std::vector<std::uint32_t> links;  // indices of neighbours along the road
  bool has_depth = false;            // false: its views serve retrieval only
  bool is_flagged = false;           // its geotag cannot be reconciled with its neighbours
};

// A viewpoint that views are cut or rendered at; its axes are those of its panorama's pano frame.
struct MapStation {
  std::uint32_t panorama_idx = 0;
  Eigen::Vector3d position_in_pano = Eigen::Vector3d::Zero();  // metres; zero = the panorama itself
};

struct MapView {
  std::uint32_t station_idx = 0, panorama_idx = 0;
  double yaw_deg = 0, pitch_deg = 0;  // in the pano frame
};

class MapBundle {
 public:
  // Reads the manifest, verifies its signature where keys are given (else the map counts as
  // unsigned), checks hash and version, and the sizes of all parts; then part by part: its bytes go
  // into memory of our own, are compared with their SHA-256, and only then HDF5 sees them. Never
  // writes. Any index that points outside its array is kBadData. Where `max_tile_bytes` is not 0,
  // tiles beyond so many are dropped again once they were checked.
  [[nodiscard]] static Result<std::shared_ptr<const MapBundle>> Open(
      const std::filesystem::path& folder, const KeyRing& trusted_keys = {},
      std::uint64_t max_tile_bytes = 0);
  // The manifest alone, hash and version checked, its signature not.
  [[nodiscard]] static Result<Manifest> ReadManifest(const std::filesystem::path& folder,
                                                     std::string* id);

  [[nodiscard]] const Manifest& manifest() const { return manifest_; }
  [[nodiscard]] const std::string& id() const { return id_; }  // SHA-256 of manifest.json
  // Who signed it; absent where no key was given to verify with.
  [[nodiscard]] const std::optional<BundleRelease>& release() const { return release_; }
  [[nodiscard]] const MapFrame& frame() const { return frame_; }
  [[nodiscard]] const Vocabulary& vocabulary() const { return vocabulary_; }
  [[nodiscard]] const std::vector<MapPanorama>& panoramas() const { return panoramas_; }
  // Stations of panorama p are [first_station(p), first_station(p + 1)): the panorama itself first.
  [[nodiscard]] const std::vector<MapStation>& stations() const { return stations_; }
  [[nodiscard]] std::uint32_t first_station(std::size_t panorama_idx) const {
    return first_station_[panorama_idx];
  }
  // View v of station s has index s * views_per_station() + v.
  [[nodiscard]] const std::vector<MapView>& views() const { return views_; }
  [[nodiscard]] std::uint32_t views_per_station() const {
    return static_cast<std::uint32_t>(views_.size() / stations_.size());
  }
  [[nodiscard]] BagOfWords BagOf(std::size_t view_idx) const;

  // Tiles come into memory as they are asked for, and leave it by Drop alone.
  [[nodiscard]] const TileCache& tiles() const { return tiles_; }
  [[nodiscard]] std::size_t TileOfView(std::size_t view_idx) const {
    return slot_of_view_[view_idx].tile;
  }
  // Views of a tile, in its order.
  [[nodiscard]] const std::vector<std::uint32_t>& ViewsOfTile(std::size_t tile) const {
    return views_of_tile_[tile];
  }
  // Ids of a tile's landmarks: [first, first of the next).
  [[nodiscard]] std::uint32_t first_landmark(std::size_t tile) const {
    return first_landmark_[tile];
  }

  // Landmarks that a view shows, as ids of this bundle.
  struct LandmarkList {
    std::uint32_t first_id = 0;  // of the tile that the numbers count from
    std::span<const std::uint32_t> numbers;
    [[nodiscard]] std::size_t size() const { return numbers.size(); }
    [[nodiscard]] std::uint32_t operator[](std::size_t i) const { return first_id + numbers[i]; }
  };
  [[nodiscard]] LandmarkList LandmarksOf(std::size_t view_idx) const;
  [[nodiscard]] std::size_t num_landmarks() const { return first_landmark_.back(); }
  [[nodiscard]] MapLandmark Landmark(std::uint32_t landmark_id) const;
  // Its 128 bytes.
  void Descriptor(std::uint32_t landmark_id, std::uint8_t* descriptor) const;
  // The depth plane that the landmark's error is shared on.
  [[nodiscard]] MapSurface SurfaceOf(std::uint32_t landmark_id, const MapLandmark& landmark) const;
  // Row of D_DB x r: similar views of panoramas, best first. A virtual station's views have those
  // of its panorama's view in the same direction.
  [[nodiscard]] std::span<const std::uint32_t> SimilarViews(std::size_t view_idx) const;

  // Whether the bundle keeps the images of its panoramas' own views: all of them or none.
  [[nodiscard]] bool has_view_images() const { return images_.num_panoramas() > 0; }
  // A view as it was described, equalised; decoded anew each time. kNotFound for views of virtual
  // stations, or where none are kept.
  [[nodiscard]] Result<GrayImage> ViewImage(std::uint32_t view_idx) const;

 private:
  explicit MapBundle(Manifest manifest)
      : manifest_(std::move(manifest)),
        frame_(manifest_.map_frame),
        tiles_([this](int fd, const std::string& name) { return ParseTile(fd, name); }) {}
  Status Load(const std::filesystem::path& folder, std::uint64_t max_tile_bytes);
  Status LoadPart(const BundlePart& part, int fd, const std::string& name);
  // The next tile in the order of parts. `read` are statuses of tiles that were read beside others.
  Status LoadTile(std::uint64_t max_tile_bytes, std::vector<Status>* read);
  [[nodiscard]] Result<MapTile> ParseTile(int fd, const std::string& name) const;
  Status LoadImages(const BundlePart& part, int fd, const std::string& name);
  Status LoadVocabulary(const Hdf5Reader& file);
  Status LoadGraph(const Hdf5Reader& file);
  Status LoadPanoramas(const Hdf5Reader& file);
  Status LoadStations(const Hdf5Reader& file);
  Status PlaceTile(std::uint32_t tile_idx);
  [[nodiscard]] std::size_t TileOf(std::uint32_t landmark_id) const;

  Manifest manifest_;
  std::string id_;
  std::optional<BundleRelease> release_;
  MapFrame frame_;
  Vocabulary vocabulary_;
  std::vector<MapPanorama> panoramas_;
  std::unordered_map<std::string, std::uint32_t> index_of_panorama_;  // by id
  std::vector<MapStation> stations_;
  std::vector<std::uint32_t> first_station_;
  std::vector<MapView> views_;
  TileCache tiles_;
  std::vector<std::vector<std::uint32_t>> views_of_tile_;
  std::vector<std::uint32_t> first_landmark_{0};  // id of each tile's first, and their number
  struct Slot {
    std::uint32_t tile = ~0U, slot = 0;
  };
  std::vector<Slot> slot_of_view_;
  MappedArray<std::uint32_t> similar_offsets_, similar_views_;
  ViewImages images_;
};

}  // namespace panofix
