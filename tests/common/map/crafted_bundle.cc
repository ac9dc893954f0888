#include "tests/common/map/crafted_bundle.h"

#include <stdlib.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "common/io/atomic_file.h"
#include "common/io/sha256.h"
#include "common/map/landmark_codes.h"
#include "tests/common/vocabulary/make_tree.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

// Tests here write hundreds of bundles and flush every file; in memory that costs nothing.
[[maybe_unused]] const int kInMemory =
    fs::is_directory("/dev/shm") ? ::setenv("TMPDIR", "/dev/shm", 0) : 0;

void WriteTree(Hdf5Writer* file, const std::string& group, const VocabularyTree& tree) {
  file->Write<std::uint8_t>(group + "/centroids", tree.centroids, kDescriptorSize);
  file->Write<std::uint32_t>(group + "/first_child", tree.first_child);
  file->Write<std::uint32_t>(group + "/num_children", tree.num_children);
  file->Write<std::uint32_t>(group + "/word", tree.word);
}

void WriteGraph(const CraftedBundle& b, const fs::path& path) {
  Hdf5Writer file(path);
  file.WriteStrings("panoramas/ids", b.ids);
  file.Write<double>("panoramas/geodetic", b.geodetic, 3);
  file.Write<double>("panoramas/position_in_map", b.positions, 3);
  file.Write<double>("panoramas/map_from_pano", b.rotations, 4);
  file.Write<double>("panoramas/point_scale", b.scales);
  file.Write<std::uint8_t>("panoramas/has_depth", b.has_depth);
  file.Write<std::uint8_t>("panoramas/is_flagged", b.is_flagged);
  file.Write<std::uint32_t>("panoramas/link_offsets", b.link_offsets);
  file.Write<std::uint32_t>("panoramas/links", b.links);
  file.Write<std::uint32_t>("stations/panorama", b.station_panoramas);
  file.Write<float>("stations/position_in_pano", b.station_positions, 3);
  file.Write<double>("views/direction_deg", b.directions, 2);
  file.Write<std::uint32_t>("similarity/offsets", b.similar_offsets);
  file.Write<std::uint32_t>("similarity/views", b.similar);
  file.Close();
}

void WriteVocabulary(const Vocabulary& vocabulary, const fs::path& path) {
  Hdf5Writer file(path);
  WriteTree(&file, "sift", vocabulary.sift);
  WriteTree(&file, "mser", vocabulary.mser);
  file.Write<float>("idf", vocabulary.idf);
  file.Close();
}

void WriteTile(const CraftedTile& tile, const fs::path& path) {
  Hdf5Writer file(path);
  file.WriteStrings("panorama_ids", tile.panorama_ids);
  file.WriteStrings("anchors/panorama_ids", tile.anchor_ids);
  file.Write<std::uint32_t>("anchors/landmark_offsets", tile.anchor_offsets);
  file.Write<std::uint32_t>("anchors/plane_offsets", tile.plane_offsets);
  file.Write<float>("anchors/planes", tile.planes, 6);
  file.Write<float>("landmarks/points_in_pano", tile.points, 3);
  file.Write<std::uint8_t>("landmarks/codes", tile.codes, tile.code_cols);
  file.Write<std::uint8_t>("landmarks/descriptors", tile.descriptors, tile.descriptor_cols);
  if (tile.landmark_words) file.Write<std::uint32_t>("landmarks/words", *tile.landmark_words);
  file.Write<std::uint32_t>("views/landmark_offsets", tile.view_offsets);
  file.Write<std::uint32_t>("views/landmarks", tile.view_landmarks);
  file.Write<std::uint32_t>("bags/offsets", tile.bag_offsets);
  file.Write<std::uint32_t>("bags/words", tile.words);
  file.Write<std::uint8_t>("bags/weights", tile.weights);
  file.Close();
}

}  // namespace

std::uint32_t CraftedTile::AddLandmark(const MapLandmark& l,
                                       std::span<const std::uint8_t> descriptor) {
  for (const double v : {l.point_in_pano.x(), l.point_in_pano.y(), l.point_in_pano.z()})
    points.push_back(static_cast<float>(v));
  codes.insert(codes.end(), {EncodeLength(l.range_sigma_m), EncodeLength(l.point_sigma_m),
                             EncodeLength(l.size_m), EncodeAngle(l.angle_deg),
                             static_cast<std::uint8_t>(l.surface_idx),
                             static_cast<std::uint8_t>(l.num_panoramas)});
  descriptors.insert(descriptors.end(), descriptor.begin(), descriptor.end());
  descriptor_cols = static_cast<int>(descriptor.size());
  return static_cast<std::uint32_t>(points.size() / 3 - 1);
}

void CraftedTile::EndAnchor(const std::string& id, const std::vector<MapSurface>& surfaces) {
  anchor_ids.push_back(id);
  anchor_offsets.push_back(static_cast<std::uint32_t>(points.size() / 3));
  for (const MapSurface& s : surfaces) {
    const Eigen::Vector3d& n = s.normal_in_pano;
    for (const double v : {n.x(), n.y(), n.z(), 5.0, s.distance_sigma_share, s.normal_sigma_rad})
      planes.push_back(static_cast<float>(v));
  }
  plane_offsets.push_back(static_cast<std::uint32_t>(planes.size() / 6));
}

void CraftedTile::EndView(const std::vector<std::uint32_t>& landmarks, const BagOfWords& bag) {
  view_landmarks.insert(view_landmarks.end(), landmarks.begin(), landmarks.end());
  view_offsets.push_back(static_cast<std::uint32_t>(view_landmarks.size()));
  float largest = 0;
  for (const WeightedWord& entry : bag) largest = std::max(largest, entry.weight);
  for (const WeightedWord& entry : bag) {
    words.push_back(entry.word);
    weights.push_back(static_cast<std::uint8_t>(std::lround(255 * entry.weight / largest)));
  }
  bag_offsets.push_back(static_cast<std::uint32_t>(words.size()));
}

void CraftedBundle::AddPanorama(const std::string& id, const Rigid3& map_from_pano,
                                const std::vector<std::uint32_t>& panorama_links, bool depth) {
  const MapFrame frame(manifest.map_frame);
  const Geodetic g = frame.ToGeodetic(map_from_pano.translation);
  const Eigen::Vector3d& t = map_from_pano.translation;
  const Eigen::Quaterniond& q = map_from_pano.rotation;
  ids.push_back(id);
  geodetic.insert(geodetic.end(), {g.lat_deg, g.lon_deg, g.height_m});
  positions.insert(positions.end(), {t.x(), t.y(), t.z()});
  rotations.insert(rotations.end(), {q.x(), q.y(), q.z(), q.w()});
  scales.push_back(frame.PointScale(g));
  has_depth.push_back(depth ? 1 : 0);
  is_flagged.push_back(0);
  AddStation(Eigen::Vector3f::Zero());
  links.insert(links.end(), panorama_links.begin(), panorama_links.end());
  link_offsets.push_back(static_cast<std::uint32_t>(links.size()));
}

void CraftedBundle::AddStation(const Eigen::Vector3f& position_in_pano) {
  station_panoramas.push_back(static_cast<std::uint32_t>(ids.size() - 1));
  station_positions.insert(station_positions.end(),
                           {position_in_pano.x(), position_in_pano.y(), position_in_pano.z()});
}

void CraftedBundle::AddWords() {
  for (CraftedTile& tile : tiles) {
    std::vector<std::uint32_t>& words_of_tile = tile.landmark_words.emplace();
    const auto row_bytes = static_cast<std::size_t>(tile.descriptor_cols);
    for (std::size_t at = 0; at < tile.descriptors.size(); at += row_bytes) {
      std::array<std::uint8_t, kDescriptorSize> whole;
      if (tile.descriptor_cols == kPackedDescriptorSize) {
        UnpackDescriptor(&tile.descriptors[at], whole.data());
      } else {
        std::copy_n(&tile.descriptors[at], whole.size(), whole.begin());
      }
      words_of_tile.push_back(vocabulary.sift.Quantize(whole.data()));
    }
  }
}

void CraftedBundle::Write(const fs::path& folder) const {
  fs::create_directories(folder);
  Manifest m = manifest;
  const auto add = [&](const std::string& path) {
    const fs::path file = folder / path;
    m.parts.push_back({path, fs::file_size(file), ValueOrThrow(Sha256OfFile(file))});
  };
  for (const auto& [path, content] : extra_parts) {
    fs::create_directories((folder / path).parent_path());
    ThrowIfError(WriteFileAtomically(folder / path, content));
    add(path);
  }
  WriteGraph(*this, folder / "graph.h5");
  add("graph.h5");
  for (const CraftedTile& tile : tiles) {
    fs::create_directories((folder / tile.path).parent_path());
    WriteTile(tile, folder / tile.path);
    add(tile.path);
  }
  for (const CraftedImages& part : images) {
    fs::create_directories((folder / part.path).parent_path());
    Hdf5Writer file(folder / part.path);
    file.WriteStrings("panorama_ids", part.panorama_ids);
    file.Write<std::uint32_t>("views/offsets", part.offsets);
    file.Write<std::uint8_t>("views/jpeg", part.jpeg);
    file.Close();
    add(part.path);
  }
  WriteVocabulary(vocabulary, folder / "vocabulary.h5");
  add("vocabulary.h5");
  m.views_per_station = static_cast<int>(directions.size() / 2);
  m.num_panoramas = static_cast<std::int64_t>(ids.size());
  m.num_stations = static_cast<std::int64_t>(station_panoramas.size());
  m.num_views = m.num_stations * m.views_per_station;
  for (const CraftedTile& tile : tiles)
    m.num_landmarks += static_cast<std::int64_t>(tile.points.size() / 3);
  ThrowIfError(WriteFileAtomically(folder / kManifestName, ToJson(m)));
  SealManifest(folder);
}

namespace {

// Landmark i of panorama p.
MapLandmark SmallLandmark(std::uint32_t p, std::uint32_t i) {
  MapLandmark landmark;
  landmark.point_in_pano = {100.0 * p + i, 1, 2};
  landmark.range_sigma_m = 0.25, landmark.point_sigma_m = 0.02, landmark.size_m = 0.4;
  landmark.angle_deg = 30, landmark.surface_idx = static_cast<int>(1 + i % 2);
  landmark.num_panoramas = static_cast<int>(1 + p);
  return landmark;
}

std::vector<MapSurface> SmallSurfaces(std::uint32_t p) {
  return {{}, {Eigen::Vector3d::UnitZ(), 0.02, 0.01}, {Eigen::Vector3d::UnitX(), 0.03 + p, 0.02}};
}

void AddSmallTile(const std::string& path, std::uint32_t first, Rng* rng, CraftedBundle* b) {
  CraftedTile& tile = b->tiles.emplace_back();
  tile.path = path;
  if (first > 0) {  // the neighbour's landmark, seen from here
    tile.AddLandmark(SmallLandmark(first - 1, 7), RandomDescriptors(1, rng));
    tile.EndAnchor(b->ids[first - 1], SmallSurfaces(first - 1));
  }
  for (const std::uint32_t p : {first, first + 1}) {
    tile.panorama_ids.push_back(b->ids[p]);
    for (std::uint32_t i = 0; i < 2 + p; ++i)
      tile.AddLandmark(SmallLandmark(p, i), RandomDescriptors(1, rng));
    tile.EndAnchor(b->ids[p], SmallSurfaces(p));
  }
  std::uint32_t slot = 0;
  for (std::uint32_t s = 0; s < b->station_panoramas.size(); ++s) {
    if (b->station_panoramas[s] != first && b->station_panoramas[s] != first + 1) continue;
    for (std::uint32_t v = 0; v < 2; ++v, ++slot) {
      std::vector<std::uint32_t> shown;
      for (std::uint32_t n = 0; n < tile.points.size() / 3; ++n) {
        if ((n + slot) % 3 != 0) shown.push_back(n);
      }
      tile.EndView(shown, {{(2 * s + v) % 4, 0.6F}, {4 + v, 0.8F}});
    }
  }
}

}  // namespace

CraftedBundle SmallBundle() {
  Rng rng(1, "tests/small_bundle");
  CraftedBundle b;
  b.manifest.name = "small";
  b.manifest.generator = "tests";
  b.manifest.map_frame = MapFrame::Tangent({48.85, 2.335, 0}).parameters();
  b.manifest.camera = Camera::FromHorizontalFov(640, 480, 70);
  b.directions = {0, 0, 180, 5};
  b.vocabulary.sift = RandomTree(2, 2, &rng);
  b.vocabulary.mser = RandomTree(2, 1, &rng);
  b.vocabulary.idf = {0.5F, 1.0F, 1.5F, 2.0F, 0.7F, 0.9F};
  const std::vector<std::vector<std::uint32_t>> links{{1}, {0, 2}, {1, 3}, {2}};
  const std::uint32_t native_view[] = {0, 1, 2, 3, 6, 7, 8, 9};
  for (std::uint32_t p = 0; p < 4; ++p) {
    b.AddPanorama(std::string(1, static_cast<char>('a' + p)),
                  {Eigen::Quaterniond::Identity(), {0, 10.0 * p, 2.5}}, links[p], p != 3);
    if (p == 1) b.AddStation({0, 4, 0});
    for (std::uint32_t row = 2 * p; row < 2 * p + 2; ++row) {
      b.similar.insert(b.similar.end(), {native_view[(row + 2) % 8], native_view[(row + 1) % 8]});
      b.similar_offsets.push_back(static_cast<std::uint32_t>(b.similar.size()));
    }
  }
  AddSmallTile("tiles/0.h5", 0, &rng, &b);
  AddSmallTile("tiles/1.h5", 2, &rng, &b);
  return b;
}

void SealManifest(const fs::path& folder) {
  const std::string hash = ValueOrThrow(Sha256OfFile(folder / kManifestName));
  ThrowIfError(WriteFileAtomically(folder / kManifestHashName, hash + "  " + kManifestName + "\n"));
}

}  // namespace panofix
