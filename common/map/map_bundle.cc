#include "common/map/map_bundle.h"

#include <fcntl.h>
#include <sys/stat.h>

#include <algorithm>
#include <cmath>

#include "common/base/log.h"
#include "common/image/gray_image.h"
#include "common/io/sha256.h"
#include "common/io/unique_fd.h"

namespace panofix {
namespace {

constexpr const char* kMend = "; fetch the bundle again or build it again";

Status Bad(const std::string& what) { return {ErrorCode::kBadData, what + kMend}; }

bool AllFinite(std::span<const double> values) {
  return std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); });
}

// offsets[0] = 0, ascending, last = size: then every slice lies inside its array.
bool AreOffsets(std::span<const std::uint32_t> offsets, std::size_t rows, std::size_t size) {
  return offsets.size() == rows + 1 && offsets.front() == 0 && offsets.back() == size &&
         std::is_sorted(offsets.begin(), offsets.end());
}

bool AllBelow(std::span<const std::uint32_t> values, std::size_t bound) {
  return std::all_of(values.begin(), values.end(), [&](std::uint32_t v) { return v < bound; });
}

// Reads array `name` into `target`, or returns the failure from the calling function.
#define PANOFIX_READ(target, file, type, name, cols)      \
  auto target##_read = (file).Read<type>(name, cols);     \
  if (!target##_read.ok()) return target##_read.status(); \
  auto target = std::move(target##_read).value()

Status LoadTree(const Hdf5Reader& file, const std::string& group, VocabularyTree* tree) {
  PANOFIX_READ(centroids, file, std::uint8_t, group + "/centroids", kDescriptorSize);
  PANOFIX_READ(first_child, file, std::uint32_t, group + "/first_child", 1);
  PANOFIX_READ(num_children, file, std::uint32_t, group + "/num_children", 1);
  PANOFIX_READ(word, file, std::uint32_t, group + "/word", 1);
  tree->centroids.assign(centroids.values.begin(), centroids.values.end());
  tree->first_child.assign(first_child.values.begin(), first_child.values.end());
  tree->num_children.assign(num_children.values.begin(), num_children.values.end());
  tree->word.assign(word.values.begin(), word.values.end());
  tree->num_words = 0;
  for (std::size_t node = 0; node < tree->word.size(); ++node) {
    if (tree->num_children.size() == tree->word.size() && tree->num_children[node] == 0)
      ++tree->num_words;
  }
  return {};
}

Result<std::string> ReadText(const std::filesystem::path& path, std::size_t max_bytes) {
  auto bytes = ReadFileBytes(path, max_bytes);
  if (!bytes.ok()) return bytes.status();
  return std::string(bytes->begin(), bytes->end());
}

}  // namespace

Result<Manifest> MapBundle::ReadManifest(const std::filesystem::path& folder, std::string* id) {
  const std::string name = (folder / kManifestName).string();
  if (!std::filesystem::is_directory(folder)) {
    return Status(ErrorCode::kNotFound, folder.string() +
                                            ": no such bundle folder; build one with "
                                            "panofix-builder build");
  }
  auto text = ReadText(folder / kManifestName, std::size_t{64} << 20);
  if (!text.ok()) return text.status();
  auto hash = ReadText(folder / kManifestHashName, 4096);
  if (!hash.ok()) return hash.status();
  *id = Sha256Hex(*text);
  if (hash->substr(0, 64) != *id) {
    // A newer format may hash another way: say so first.
    const auto parsed = ParseManifest(*text, name);
    if (!parsed.ok() && parsed.status().code() == ErrorCode::kUnsupportedVersion)
      return parsed.status();
    return Status(ErrorCode::kChecksumMismatch,
                  name + ": its SHA-256 is not the one in " + kManifestHashName + kMend);
  }
  return ParseManifest(*text, name);
}

Result<std::shared_ptr<const MapBundle>> MapBundle::Open(const std::filesystem::path& folder) {
  std::string id;
  auto manifest = ReadManifest(folder, &id);
  if (!manifest.ok()) return manifest.status();
  std::shared_ptr<MapBundle> bundle(new MapBundle(std::move(manifest).value()));
  bundle->id_ = id;
  // The graph first (it names the panoramas), the vocabulary next, then the tiles.
  std::vector<BundlePart> parts = bundle->manifest_.parts;
  const auto rank = [](const BundlePart& p) {
    return p.path == "graph.h5" ? 0 : p.path == "vocabulary.h5" ? 1 : 2;
  };
  std::stable_sort(parts.begin(), parts.end(),
                   [&](const BundlePart& a, const BundlePart& b) { return rank(a) < rank(b); });
  if (parts.size() < 2 || rank(parts[0]) != 0 || rank(parts[1]) != 1) {
    return Bad(folder.string() + ": graph.h5 or vocabulary.h5 is not in the manifest");
  }
  for (const BundlePart& part : parts) {
    const std::string name = (folder / part.path).string();
    const UniqueFd fd(::open(name.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
    struct stat info {};
    if (!fd.valid() || ::fstat(fd.get(), &info) != 0 || !S_ISREG(info.st_mode)) {
      return Status(ErrorCode::kNotFound, name + ": cannot be read" + kMend);
    }
    if (static_cast<std::uint64_t>(info.st_size) != part.num_bytes) {
      return Status(ErrorCode::kChecksumMismatch,
                    Format("%s: %lld bytes, the manifest says %llu%s", name.c_str(),
                           static_cast<long long>(info.st_size),
                           static_cast<unsigned long long>(part.num_bytes), kMend));
    }
    const auto hash = Sha256OfDescriptor(fd.get(), name);
    if (!hash.ok()) return hash.status();
    if (*hash != part.sha256) {
      return Status(ErrorCode::kChecksumMismatch,
                    name + ": its SHA-256 is not the manifest's" + kMend);
    }
    const Status status = bundle->LoadPart(part, fd.get(), name);
    // An array that is not there is the bundle's fault, not the caller's.
    const ErrorCode code =
        status.code() == ErrorCode::kNotFound ? ErrorCode::kBadData : status.code();
    if (!status.ok()) return Status(code, name + ": " + status.message());
  }
  for (const Slice& slice : bundle->slices_) {
    if (slice.tile == ~0U) return Bad(folder.string() + ": a panorama of graph.h5 is in no tile");
  }
  return std::shared_ptr<const MapBundle>(std::move(bundle));
}

Status MapBundle::LoadPart(const BundlePart& part, int fd, const std::string& name) {
  const bool is_tile = part.path.starts_with("tiles/");
  // Parts of later minor versions are verified and left alone, whatever their format.
  if (part.path != "graph.h5" && part.path != "vocabulary.h5" && !is_tile) return {};
  auto file = Hdf5Reader::Open(fd, name);
  if (!file.ok()) return file.status();
  if (is_tile) return LoadTile(*file);
  return part.path == "graph.h5" ? LoadGraph(*file) : LoadVocabulary(*file);
}

Status MapBundle::LoadVocabulary(const Hdf5Reader& file) {
  Status status = LoadTree(file, "sift", &vocabulary_.sift);
  if (status.ok()) status = LoadTree(file, "mser", &vocabulary_.mser);
  if (!status.ok()) return status;
  PANOFIX_READ(idf, file, float, "idf", 1);
  vocabulary_.idf.assign(idf.values.begin(), idf.values.end());
  return vocabulary_.Check();
}

Status MapBundle::LoadPanoramas(const Hdf5Reader& file) {
  auto ids = file.ReadStrings("panoramas/ids");
  if (!ids.ok()) return ids.status();
  PANOFIX_READ(geodetic, file, double, "panoramas/geodetic", 3);
  PANOFIX_READ(positions, file, double, "panoramas/position_in_map", 3);
  PANOFIX_READ(rotations, file, double, "panoramas/map_from_pano", 4);
  PANOFIX_READ(scales, file, double, "panoramas/point_scale", 1);
  PANOFIX_READ(has_depth, file, std::uint8_t, "panoramas/has_depth", 1);
  PANOFIX_READ(link_offsets, file, std::uint32_t, "panoramas/link_offsets", 1);
  PANOFIX_READ(links, file, std::uint32_t, "panoramas/links", 1);
  const std::size_t n = ids->size();
  const auto rows = static_cast<std::int64_t>(n);
  if (geodetic.rows != rows || positions.rows != rows || rotations.rows != rows ||
      scales.rows != rows || has_depth.rows != rows ||
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
    panorama.links.assign(links.values.begin() + link_offsets.values[i],
                          links.values.begin() + link_offsets.values[i + 1]);
    panoramas_.push_back(std::move(panorama));
  }
  return {};
}

Status MapBundle::LoadGraph(const Hdf5Reader& file) {
  const Status status = LoadPanoramas(file);
  if (!status.ok()) return status;
  PANOFIX_READ(directions, file, double, "views/direction_deg", 2);
  const std::size_t per_panorama = static_cast<std::size_t>(directions.rows);
  if (per_panorama == 0 || panoramas_.empty() || !AllFinite(directions.values))
    return Bad("no views");
  for (std::uint32_t panorama = 0; panorama < panoramas_.size(); ++panorama) {
    for (std::size_t v = 0; v < per_panorama; ++v) {
      views_.push_back({panorama, directions.values[2 * v], directions.values[2 * v + 1]});
    }
  }
  PANOFIX_READ(offsets, file, std::uint32_t, "similarity/offsets", 1);
  PANOFIX_READ(similar, file, std::uint32_t, "similarity/views", 1);
  if (!AreOffsets(offsets.values, views_.size(), similar.values.size()) ||
      !AllBelow(similar.values, views_.size())) {
    return Bad("similarity index points outside the views");
  }
  similar_offsets_ = std::move(offsets);
  similar_views_ = std::move(similar);
  slices_.assign(views_.size(), {~0U, 0, 0});
  bags_.resize(views_.size());
  for (std::uint32_t i = 0; i < panoramas_.size(); ++i) index_of_panorama_[panoramas_[i].id] = i;
  normals_.resize(panoramas_.size());
  return {};
}

Status MapBundle::LoadTile(const Hdf5Reader& file) {
  auto ids = file.ReadStrings("panorama_ids");
  if (!ids.ok()) return ids.status();
  PANOFIX_READ(offsets, file, std::uint32_t, "view_offsets", 1);
  Tile tile;
  PANOFIX_READ(keypoints, file, float, "keypoints", 4);
  PANOFIX_READ(points, file, float, "points_in_pano", 4);
  PANOFIX_READ(surfaces, file, std::uint8_t, "surfaces", 1);
  PANOFIX_READ(descriptors, file, std::uint8_t, "descriptors", kDescriptorSize);
  const std::size_t per_panorama = views_.size() / panoramas_.size();
  if (points.rows != keypoints.rows || surfaces.rows != keypoints.rows ||
      descriptors.rows != keypoints.rows ||
      !AreOffsets(offsets.values, ids->size() * per_panorama,
                  static_cast<std::size_t>(keypoints.rows))) {
    return Bad("feature arrays disagree");
  }
  const auto finite = [](float v) { return std::isfinite(v); };
  if (!std::all_of(points.values.begin(), points.values.end(), finite) ||
      !std::all_of(keypoints.values.begin(), keypoints.values.end(), finite)) {
    return Bad("features are not finite");
  }
  std::vector<std::uint32_t> view_of_slot, panorama_of_slot;
  for (std::size_t p = 0; p < ids->size(); ++p) {
    const auto found = index_of_panorama_.find((*ids)[p]);
    if (found == index_of_panorama_.end())
      return Bad("panorama " + (*ids)[p] + " is not in graph.h5");
    if (slices_[found->second * per_panorama].tile != ~0U)
      return Bad("panorama " + (*ids)[p] + " is in two tiles");
    panorama_of_slot.push_back(found->second);
    for (std::size_t v = 0; v < per_panorama; ++v) {
      const std::size_t view = found->second * per_panorama + v, slot = p * per_panorama + v;
      slices_[view] = {static_cast<std::uint32_t>(tiles_.size()), offsets.values[slot],
                       offsets.values[slot + 1]};
      view_of_slot.push_back(static_cast<std::uint32_t>(view));
    }
  }
  tile.keypoints = std::move(keypoints);
  tile.points = std::move(points);
  tile.surfaces = std::move(surfaces);
  tile.descriptors = std::move(descriptors);
  tiles_.push_back(std::move(tile));
  const Status status = LoadPlanes(file, panorama_of_slot);
  if (!status.ok()) return status;
  return LoadBags(file, view_of_slot);
}

Status MapBundle::LoadPlanes(const Hdf5Reader& file,
                             const std::vector<std::uint32_t>& panorama_of_slot) {
  PANOFIX_READ(offsets, file, std::uint32_t, "plane_offsets", 1);
  PANOFIX_READ(planes, file, float, "planes", 4);
  if (!AreOffsets(offsets.values, panorama_of_slot.size(), static_cast<std::size_t>(planes.rows))) {
    return Bad("depth planes disagree");
  }
  for (std::size_t slot = 0; slot < panorama_of_slot.size(); ++slot) {
    auto& normals = normals_[panorama_of_slot[slot]];
    for (std::uint32_t i = offsets.values[slot]; i < offsets.values[slot + 1]; ++i) {
      const Eigen::Vector3f normal(&planes.values[4 * std::size_t{i}]);
      const float length = normal.norm();
      // Plane 0 is unused and may be anything.
      normals.push_back(length > 0.5F && length < 2.0F ? Eigen::Vector3f(normal / length)
                                                       : Eigen::Vector3f::Zero());
    }
  }
  return {};
}

Status MapBundle::LoadBags(const Hdf5Reader& file, const std::vector<std::uint32_t>& view_of_slot) {
  PANOFIX_READ(offsets, file, std::uint32_t, "bags/offsets", 1);
  PANOFIX_READ(words, file, std::uint32_t, "bags/words", 1);
  PANOFIX_READ(weights, file, float, "bags/weights", 1);
  if (weights.rows != words.rows || !AllBelow(words.values, vocabulary_.num_words()) ||
      !AreOffsets(offsets.values, view_of_slot.size(), words.values.size())) {
    return Bad("bags of words disagree");
  }
  for (std::size_t slot = 0; slot < view_of_slot.size(); ++slot) {
    BagOfWords& bag = bags_[view_of_slot[slot]];
    for (std::uint32_t i = offsets.values[slot]; i < offsets.values[slot + 1]; ++i) {
      if (!std::isfinite(weights.values[i])) return Bad("bags of words are not finite");
      bag.push_back({words.values[i], weights.values[i]});
    }
  }
  return {};
}

#undef PANOFIX_READ

ViewFeatures MapBundle::Features(std::size_t view_idx) const {
  const Slice& slice = slices_.at(view_idx);
  const Tile& tile = tiles_[slice.tile];
  const std::size_t begin = slice.begin, count = slice.end - slice.begin;
  return {tile.keypoints.values.subspan(begin * 4, count * 4),
          tile.points.values.subspan(begin * 4, count * 4),
          tile.surfaces.values.subspan(begin, count),
          tile.descriptors.values.subspan(begin * kDescriptorSize, count * kDescriptorSize)};
}

Eigen::Vector3d MapBundle::SurfaceNormal(std::size_t panorama_idx, std::uint8_t surface_idx) const {
  const auto& normals = normals_.at(panorama_idx);
  return surface_idx < normals.size() ? Eigen::Vector3d(normals[surface_idx].cast<double>())
                                      : Eigen::Vector3d::Zero();
}

std::span<const std::uint32_t> MapBundle::SimilarViews(std::size_t view_idx) const {
  const std::uint32_t begin = similar_offsets_.values[view_idx],
                      end = similar_offsets_.values[view_idx + 1];
  return similar_views_.values.subspan(begin, end - begin);
}

}  // namespace panofix
