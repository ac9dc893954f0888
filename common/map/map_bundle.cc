#include "common/map/map_bundle.h"

#include <algorithm>
#include <cmath>

#include "common/base/cancel.h"
#include "common/base/log.h"
#include "common/image/gray_image.h"
#include "common/io/sha256.h"
#include "common/map/landmark_codes.h"
#include "common/map/map_arrays.h"
#include "common/map/vocabulary_file.h"

namespace panofix {

using namespace map_internal;

namespace {

bool IsTile(const BundlePart& part) { return part.path.starts_with("tiles/"); }

}  // namespace

Result<Manifest> MapBundle::ReadManifest(const std::filesystem::path& folder, std::string* id) {
  auto manifest = ReadSignedManifest(folder, {});
  if (!manifest.ok()) return manifest.status();
  *id = manifest->id;
  return std::move(manifest->manifest);
}

Result<std::shared_ptr<const MapBundle>> MapBundle::Open(const std::filesystem::path& folder,
                                                         const KeyRing& trusted_keys,
                                                         std::uint64_t max_tile_bytes) {
  auto manifest = ReadSignedManifest(folder, trusted_keys);
  if (!manifest.ok()) return manifest.status();
  std::shared_ptr<MapBundle> bundle(new MapBundle(std::move(manifest->manifest)));
  bundle->id_ = manifest->id;
  bundle->release_ = std::move(manifest->release);
  if (Status status = bundle->Load(folder, max_tile_bytes); !status.ok()) return status;
  return std::shared_ptr<const MapBundle>(std::move(bundle));
}

Status MapBundle::Load(const std::filesystem::path& folder, std::uint64_t max_tile_bytes) {
  // The graph first (it names the panoramas), the vocabulary next, then the tiles.
  std::vector<BundlePart> parts = manifest_.parts;
  const auto rank = [](const BundlePart& p) {
    return p.path == "graph.h5" ? 0 : p.path == "vocabulary.h5" ? 1 : 2;
  };
  std::stable_sort(parts.begin(), parts.end(),
                   [&](const BundlePart& a, const BundlePart& b) { return rank(a) < rank(b); });
  if (parts.size() < 2 || rank(parts[0]) != 0 || rank(parts[1]) != 1)
    return Bad(folder.string() + ": graph.h5 or vocabulary.h5 is not in the manifest");
  auto descriptors = OpenParts(folder, parts);
  if (!descriptors.ok()) return descriptors.status();
  for (std::size_t i = 0; i < parts.size(); ++i) {
    if (!IsTile(parts[i])) continue;
    tiles_.Add(parts[i], std::move((*descriptors)[i]), (folder / parts[i].path).string());
  }
  std::vector<Status> read;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    if (CancelRequested()) return {ErrorCode::kCancelled, folder.string() + ": interrupted"};
    const std::string name = (folder / parts[i].path).string();
    const Status status = IsTile(parts[i]) ? LoadTile(max_tile_bytes, &read)
                                           : LoadPart(parts[i], (*descriptors)[i].get(), name);
    // An array that is not there is the bundle's fault, not the caller's.
    const ErrorCode code =
        status.code() == ErrorCode::kNotFound ? ErrorCode::kBadData : status.code();
    if (status.code() == ErrorCode::kChecksumMismatch) return status;
    if (!status.ok()) return {code, name + ": " + status.message()};
  }
  for (const Slot& slot : slot_of_view_) {
    if (slot.tile == ~0U) return Bad(folder.string() + ": a panorama of graph.h5 is in no tile");
  }
  if (has_view_images() && images_.num_panoramas() != panoramas_.size())
    return Bad(folder.string() + ": images of some panoramas are there, of others not");
  return {};
}

Result<MapTile> MapBundle::ParseTile(int fd, const std::string& name) const {
  auto file = Hdf5Reader::Open(fd, name);
  if (!file.ok()) return file.status();
  return MapTile::Load(*file, index_of_panorama_, vocabulary_);
}

Status MapBundle::LoadTile(std::uint64_t max_tile_bytes, std::vector<Status>* read) {
  const std::size_t tile = views_of_tile_.size();
  if (tile == read->size()) {
    // As many at once as there is room for; they are placed one by one, so that of several faults
    // the first in order is told.
    std::size_t end = tile + 1;
    std::uint64_t num_bytes = tiles_.num_loaded_bytes() + tiles_.num_bytes(tile);
    for (; end < tiles_.size(); ++end) {
      num_bytes += tiles_.num_bytes(end);
      if (max_tile_bytes > 0 && num_bytes > max_tile_bytes) break;
    }
    const std::vector<Status> more = tiles_.ReadFirst(tile, end);
    read->insert(read->end(), more.begin(), more.end());
    if (CancelRequested()) return {ErrorCode::kCancelled, "interrupted"};
  }
  Status status = (*read)[tile];
  if (status.ok()) status = PlaceTile(static_cast<std::uint32_t>(tile));
  if (status.ok() && max_tile_bytes > 0 && tiles_.num_loaded_bytes() > max_tile_bytes)
    tiles_.Drop(tile);
  return status;
}

Status MapBundle::LoadPart(const BundlePart& part, int fd, const std::string& name) {
  if (part.path.starts_with("images/")) return LoadImages(part, fd, name);
  const auto copy = CopyVerifiedPart(fd, part, name);
  if (!copy.ok()) return copy.status();
  // Parts of later minor versions are verified and left alone, whatever their format.
  if (part.path != "graph.h5" && part.path != "vocabulary.h5") return {};
  auto file = Hdf5Reader::Open(copy->get(), name);
  if (!file.ok()) return file.status();
  return part.path == "graph.h5" ? LoadGraph(*file) : LoadVocabulary(*file);
}

// Pictures stay in their files: they are large and rarely looked at.
Status MapBundle::LoadImages(const BundlePart& part, int fd, const std::string& name) {
  const auto hash = Sha256OfDescriptor(fd, name);
  if (!hash.ok()) return hash.status();
  if (*hash != part.sha256) {
    return {ErrorCode::kChecksumMismatch, name + ": its SHA-256 is not the manifest's" + kMend};
  }
  auto file = Hdf5Reader::Open(fd, name);
  if (!file.ok()) return file.status();
  return images_.Load(*file, index_of_panorama_, views_per_station());
}

Status MapBundle::LoadVocabulary(const Hdf5Reader& file) {
  auto vocabulary = ReadVocabulary(file);
  if (!vocabulary.ok()) return vocabulary.status();
  vocabulary_ = std::move(vocabulary).value();
  return {};
}

Status MapBundle::LoadPanoramas(const Hdf5Reader& file) {
  auto ids = file.ReadStrings("panoramas/ids");
  if (!ids.ok()) return ids.status();
  PANOFIX_READ(geodetic, file, double, "panoramas/geodetic", 3);
  PANOFIX_READ(positions, file, double, "panoramas/position_in_map", 3);
  PANOFIX_READ(rotations, file, double, "panoramas/map_from_pano", 4);
  PANOFIX_READ(scales, file, double, "panoramas/point_scale", 1);
  PANOFIX_READ(has_depth, file, std::uint8_t, "panoramas/has_depth", 1);
  PANOFIX_READ(is_flagged, file, std::uint8_t, "panoramas/is_flagged", 1);
  PANOFIX_READ(link_offsets, file, std::uint32_t, "panoramas/link_offsets", 1);
  PANOFIX_READ(links, file, std::uint32_t, "panoramas/links", 1);
  const std::size_t n = ids->size();
  const auto rows = static_cast<std::int64_t>(n);
  if (geodetic.rows != rows || positions.rows != rows || rotations.rows != rows ||
      scales.rows != rows || has_depth.rows != rows || is_flagged.rows != rows ||
      !AreOffsets(link_offsets.values, n, links.values.size()) || !AllBelow(links.values, n)) {
    return Bad("panorama arrays disagree");
  }
  if (!AllFinite(geodetic.values) || !AllFinite(positions.values) || !AllFinite(rotations.values) ||
      !AllFinite(scales.values)) {
    return Bad("panorama poses are not finite");
  }
  for (std::size_t i = 0; i < n; ++i) {
    MapPanorama panorama;
    panorama.id = (*ids)[i];
    panorama.position = {geodetic.values[3 * i], geodetic.values[3 * i + 1],
                         geodetic.values[3 * i + 2]};
    const double* q = &rotations.values[4 * i];  // x y z w
    const Eigen::Quaterniond rotation(q[3], q[0], q[1], q[2]);
    if (std::abs(rotation.norm() - 1) > 1e-6 || !(scales.values[i] > 0.5 && scales.values[i] < 2)) {
      return Bad("panorama " + panorama.id + ": attitude or scale out of range");
    }
    panorama.map_from_pano =
        Rigid3(rotation.normalized(), Eigen::Vector3d(&positions.values[3 * i]));
    panorama.point_scale = scales.values[i];
    panorama.has_depth = has_depth.values[i] != 0;
    panorama.is_flagged = is_flagged.values[i] != 0;
    panorama.links.assign(links.values.begin() + link_offsets.values[i],
                          links.values.begin() + link_offsets.values[i + 1]);
    panoramas_.push_back(std::move(panorama));
  }
  return {};
}

constexpr float kFarthestStation_m = 1000;  // from its panorama

Status MapBundle::LoadStations(const Hdf5Reader& file) {
  PANOFIX_READ(owners, file, std::uint32_t, "stations/panorama", 1);
  PANOFIX_READ(positions, file, float, "stations/position_in_pano", 3);
  if (positions.rows != owners.rows || !AllFinite(positions.values) ||
      !std::is_sorted(owners.values.begin(), owners.values.end())) {
    return Bad("stations disagree");
  }
  for (std::size_t s = 0; s < owners.values.size(); ++s) {
    const std::uint32_t owner = owners.values[s];
    const Eigen::Vector3f position(&positions.values[3 * s]);
    if (owner == first_station_.size()) first_station_.push_back(static_cast<std::uint32_t>(s));
    // A panorama's first station is itself.
    const bool is_first = owner < first_station_.size() && first_station_[owner] == s;
    if (owner >= panoramas_.size() || owner + 1 != first_station_.size() ||
        (is_first && position.norm() > 0) || !(position.norm() < kFarthestStation_m)) {
      return Bad("stations do not follow the panoramas");
    }
    stations_.push_back({owner, position.cast<double>()});
  }
  if (first_station_.size() != panoramas_.size()) return Bad("a panorama has no station");
  first_station_.push_back(static_cast<std::uint32_t>(stations_.size()));
  return {};
}

Status MapBundle::LoadGraph(const Hdf5Reader& file) {
  Status status = LoadPanoramas(file);
  if (status.ok()) status = LoadStations(file);
  if (!status.ok()) return status;
  PANOFIX_READ(directions, file, double, "views/direction_deg", 2);
  const auto per_station = static_cast<std::size_t>(directions.rows);
  if (per_station == 0 || panoramas_.empty() || !AllFinite(directions.values))
    return Bad("no views");
  for (std::uint32_t s = 0; s < stations_.size(); ++s) {
    for (std::size_t v = 0; v < per_station; ++v) {
      views_.push_back(
          {s, stations_[s].panorama_idx, directions.values[2 * v], directions.values[2 * v + 1]});
    }
  }
  PANOFIX_READ(offsets, file, std::uint32_t, "similarity/offsets", 1);
  PANOFIX_READ(similar, file, std::uint32_t, "similarity/views", 1);
  if (!AreOffsets(offsets.values, panoramas_.size() * per_station, similar.values.size()) ||
      !AllBelow(similar.values, views_.size())) {
    return Bad("similarity index points outside the views");
  }
  similar_offsets_ = std::move(offsets);
  similar_views_ = std::move(similar);
  slot_of_view_.assign(views_.size(), {});
  for (std::uint32_t i = 0; i < panoramas_.size(); ++i) index_of_panorama_[panoramas_[i].id] = i;
  return {};
}

Status MapBundle::PlaceTile(std::uint32_t tile_idx) {
  const MapTile& tile = tiles_.Get(tile_idx);
  std::vector<std::uint32_t>& views = views_of_tile_.emplace_back();
  for (const std::uint32_t panorama : tile.panoramas()) {
    const std::uint32_t begin = first_station(panorama) * views_per_station();
    const std::uint32_t end = first_station(panorama + 1) * views_per_station();
    if (slot_of_view_[begin].tile != ~0U)
      return Bad("panorama " + panoramas_[panorama].id + " is in two tiles");
    if (views.size() + (end - begin) > tile.num_views())
      return Bad("views disagree with the stations");
    for (std::uint32_t view = begin; view < end; ++view) {
      slot_of_view_[view] = {tile_idx, static_cast<std::uint32_t>(views.size())};
      views.push_back(view);
    }
  }
  if (views.size() != tile.num_views()) return Bad("views disagree with the stations");
  if (tile.num_landmarks() > ~std::uint32_t{0} - first_landmark_.back())
    return Bad("more landmarks than have a number");
  first_landmark_.push_back(first_landmark_.back() +
                            static_cast<std::uint32_t>(tile.num_landmarks()));
  return {};
}

#undef PANOFIX_READ

MapBundle::LandmarkList MapBundle::LandmarksOf(std::size_t view_idx) const {
  const Slot& slot = slot_of_view_.at(view_idx);
  return {first_landmark_[slot.tile], tiles_.Get(slot.tile).LandmarksOf(slot.slot)};
}

BagOfWords MapBundle::BagOf(std::size_t view_idx) const {
  const Slot& slot = slot_of_view_.at(view_idx);
  return tiles_.Get(slot.tile).Bag(slot.slot);
}

std::size_t MapBundle::TileOf(std::uint32_t landmark_id) const {
  const auto after = std::upper_bound(first_landmark_.begin(), first_landmark_.end(), landmark_id);
  return static_cast<std::size_t>(after - first_landmark_.begin()) - 1;
}

MapLandmark MapBundle::Landmark(std::uint32_t landmark_id) const {
  const std::size_t tile = TileOf(landmark_id);
  return tiles_.Get(tile).Landmark(landmark_id - first_landmark_[tile]);
}

void MapBundle::Descriptor(std::uint32_t landmark_id, std::uint8_t* descriptor) const {
  const std::size_t tile = TileOf(landmark_id);
  tiles_.Get(tile).Descriptor(landmark_id - first_landmark_[tile], descriptor);
}

MapSurface MapBundle::SurfaceOf(std::uint32_t landmark_id, const MapLandmark& landmark) const {
  return tiles_.Get(TileOf(landmark_id)).Surface(landmark.panorama_idx, landmark.surface_idx);
}

Result<GrayImage> MapBundle::ViewImage(std::uint32_t view_idx) const {
  const MapView& view = views_.at(view_idx);
  if (view.station_idx != first_station(view.panorama_idx))
    return Status(ErrorCode::kNotFound, "views of virtual stations have no image");
  return images_.Decode(view.panorama_idx, view_idx % views_per_station(), manifest_.camera);
}

std::span<const std::uint32_t> MapBundle::SimilarViews(std::size_t view_idx) const {
  const std::size_t row = std::size_t{views_[view_idx].panorama_idx} * views_per_station() +
                          view_idx % views_per_station();
  const std::uint32_t begin = similar_offsets_.values[row], end = similar_offsets_.values[row + 1];
  return similar_views_.values.subspan(begin, end - begin);
}

}  // namespace panofix
