#include "tests/common/map/crafted_bundle.h"

#include <stdlib.h>

#include "common/io/atomic_file.h"
#include "common/io/sha256.h"
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
  file.Write<std::uint32_t>("panoramas/link_offsets", b.link_offsets);
  file.Write<std::uint32_t>("panoramas/links", b.links);
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
  file.Write<std::uint32_t>("view_offsets", tile.view_offsets);
  file.Write<std::uint32_t>("plane_offsets", tile.plane_offsets);
  file.Write<float>("planes", tile.planes, 4);
  file.Write<std::uint8_t>("surfaces", tile.surfaces);
  file.Write<float>("keypoints", tile.keypoints, 4);
  file.Write<float>("points_in_pano", tile.points, 4);
  file.Write<std::uint8_t>("descriptors", tile.descriptors, kDescriptorSize);
  file.Write<std::uint32_t>("bags/offsets", tile.bag_offsets);
  file.Write<std::uint32_t>("bags/words", tile.words);
  file.Write<float>("bags/weights", tile.weights);
  file.Close();
}

}  // namespace

void CraftedTile::AddFeature(const Keypoint& k, const Eigen::Vector3d& p, double range_sigma_m,
                             std::span<const std::uint8_t> descriptor, std::uint8_t surface_idx) {
  keypoints.insert(keypoints.end(), {k.x_px, k.y_px, k.size_px, k.angle_deg});
  for (const double v : {p.x(), p.y(), p.z(), range_sigma_m})
    points.push_back(static_cast<float>(v));
  descriptors.insert(descriptors.end(), descriptor.begin(), descriptor.end());
  surfaces.push_back(surface_idx);
}

void CraftedTile::EndView(const BagOfWords& bag) {
  view_offsets.push_back(static_cast<std::uint32_t>(keypoints.size() / 4));
  for (const WeightedWord& entry : bag)
    words.push_back(entry.word), weights.push_back(entry.weight);
  bag_offsets.push_back(static_cast<std::uint32_t>(words.size()));
}

void CraftedTile::EndPanorama(const std::vector<Eigen::Vector4d>& panorama_planes) {
  for (const Eigen::Vector4d& plane : panorama_planes) {
    for (const double v : {plane[0], plane[1], plane[2], plane[3]})
      planes.push_back(static_cast<float>(v));
  }
  plane_offsets.push_back(static_cast<std::uint32_t>(planes.size() / 4));
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
  links.insert(links.end(), panorama_links.begin(), panorama_links.end());
  link_offsets.push_back(static_cast<std::uint32_t>(links.size()));
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
  WriteVocabulary(vocabulary, folder / "vocabulary.h5");
  add("vocabulary.h5");
  m.views_per_panorama = static_cast<int>(directions.size() / 2);
  m.num_panoramas = static_cast<std::int64_t>(ids.size());
  m.num_views = m.num_panoramas * m.views_per_panorama;
  ThrowIfError(WriteFileAtomically(folder / kManifestName, ToJson(m)));
  SealManifest(folder);
}

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
  for (std::uint32_t p = 0; p < 4; ++p) {
    b.AddPanorama(std::string(1, static_cast<char>('a' + p)),
                  {Eigen::Quaterniond::Identity(), {0, 10.0 * p, 2.5}}, links[p], p != 3);
    if (p % 2 == 0) b.tiles.emplace_back().path = p == 0 ? "tiles/0.h5" : "tiles/1.h5";
    CraftedTile& tile = b.tiles.back();
    tile.panorama_ids.push_back(b.ids.back());
    for (std::uint32_t v = 0; v < 2; ++v) {
      for (std::uint32_t i = 0; i < (3 * p + 2 * v) % 6; ++i) {
        const auto at = static_cast<float>(100 * p + 10 * v + i);
        tile.AddFeature({at, at + 1, 4, 30, 0}, {at, 1, 2}, 0.25, RandomDescriptors(1, &rng),
                        static_cast<std::uint8_t>(1 + i % 2));
      }
      const std::uint32_t view = 2 * p + v;
      tile.EndView({{view % 4, 0.6F}, {4 + v, 0.8F}});
      b.similar.insert(b.similar.end(), {(view + 2) % 8, (view + 1) % 8});
      b.similar_offsets.push_back(static_cast<std::uint32_t>(b.similar.size()));
    }
    tile.EndPanorama({{0, 0, 0, 0}, {0, 0, 1, -2.5}, {1, 0, 0, 5.0 + p}});
  }
  return b;
}

void SealManifest(const fs::path& folder) {
  const std::string hash = ValueOrThrow(Sha256OfFile(folder / kManifestName));
  ThrowIfError(WriteFileAtomically(folder / kManifestHashName, hash + "  " + kManifestName + "\n"));
}

}  // namespace panofix
