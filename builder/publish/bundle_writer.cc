#include "builder/publish/bundle_writer.h"

#include <unistd.h>

#include <algorithm>

#include "common/base/cancel.h"
#include "common/base/log.h"
#include "common/io/atomic_file.h"
#include "common/io/hdf5_file.h"
#include "common/io/sha256.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

// "out/" names the folder "out": staging must lie beside it, not in it.
fs::path WithoutTrailingSlash(const fs::path& path) {
  return path.has_filename() ? path : path.parent_path();
}

// A folder that is removed unless it was published.
class Staging {
 public:
  explicit Staging(const fs::path& target)
      : path_(WithoutTrailingSlash(target).string() +
              Format(".staging-%d", static_cast<int>(getpid()))) {
    std::error_code error;
    fs::remove_all(path_, error);
    if (!fs::create_directories(path_ / "tiles", error)) {
      throw Error(ErrorCode::kIo, path_.string() + ": cannot be made (" + error.message() +
                                      "); choose an --out folder you may write to");
    }
  }
  ~Staging() {
    std::error_code error;
    fs::remove_all(path_, error);
  }
  [[nodiscard]] const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

void WriteTree(Hdf5Writer* file, const std::string& group, const VocabularyTree& tree) {
  file->Write<std::uint8_t>(group + "/centroids", tree.centroids, kDescriptorSize);
  file->Write<std::uint32_t>(group + "/first_child", tree.first_child);
  file->Write<std::uint32_t>(group + "/num_children", tree.num_children);
  file->Write<std::uint32_t>(group + "/word", tree.word);
}

void WriteVocabulary(const fs::path& path, const Vocabulary& vocabulary) {
  Hdf5Writer file(path);
  WriteTree(&file, "sift", vocabulary.sift);
  WriteTree(&file, "mser", vocabulary.mser);
  file.Write<float>("idf", vocabulary.idf);
  file.Close();
}

void WriteGraph(const fs::path& path, const BundleContent& content) {
  std::vector<std::string> ids;
  std::vector<double> geodetic, position, rotation, scale, directions;
  std::vector<std::uint8_t> has_depth;
  std::vector<std::uint32_t> link_offsets{0}, links;
  for (const MapPanorama& p : content.panoramas) {
    ids.push_back(p.id);
    geodetic.insert(geodetic.end(), {p.position.lat_deg, p.position.lon_deg, p.position.height_m});
    const Eigen::Vector3d& t = p.map_from_pano.translation;
    const Eigen::Quaterniond& q = p.map_from_pano.rotation;
    position.insert(position.end(), {t.x(), t.y(), t.z()});
    rotation.insert(rotation.end(), {q.x(), q.y(), q.z(), q.w()});
    scale.push_back(p.point_scale);
    has_depth.push_back(p.has_depth ? 1 : 0);
    links.insert(links.end(), p.links.begin(), p.links.end());
    link_offsets.push_back(static_cast<std::uint32_t>(links.size()));
  }
  for (const ViewDirection& d : content.directions)
    directions.insert(directions.end(), {d.yaw_deg, d.pitch_deg});
  Hdf5Writer file(path);
  file.WriteStrings("panoramas/ids", ids);
  file.Write<double>("panoramas/geodetic", geodetic, 3);
  file.Write<double>("panoramas/position_in_map", position, 3);
  file.Write<double>("panoramas/map_from_pano", rotation, 4);
  file.Write<double>("panoramas/point_scale", scale);
  file.Write<std::uint8_t>("panoramas/has_depth", has_depth);
  file.Write<std::uint32_t>("panoramas/link_offsets", link_offsets);
  file.Write<std::uint32_t>("panoramas/links", links);
  file.Write<double>("views/direction_deg", directions, 2);
  file.Write<std::uint32_t>("similarity/offsets", content.similarity.offsets);
  file.Write<std::uint32_t>("similarity/views", content.similarity.views);
  file.Write<float>("similarity/cosine", content.similarity.similarity);
  file.Close();
}

// Panoramas [begin, end) share a tile. Returns its number of features.
std::int64_t WriteTile(const fs::path& path, const BundleContent& content, std::size_t begin,
                       std::size_t end, const FeaturesOfPanorama& features_of_panorama) {
  std::vector<std::string> ids;
  std::vector<std::uint32_t> view_offsets{0}, plane_offsets{0}, bag_offsets{0}, words;
  std::vector<float> planes, keypoints, points, weights;
  std::vector<std::uint8_t> surfaces, descriptors;
  for (std::size_t p = begin; p < end; ++p) {
    ids.push_back(content.panoramas[p].id);
    const BundlePanorama panorama = features_of_panorama(p);
    planes.insert(planes.end(), panorama.planes.begin(), panorama.planes.end());
    plane_offsets.push_back(static_cast<std::uint32_t>(planes.size() / 4));
    for (const BundleView& view : panorama.views) {
      surfaces.insert(surfaces.end(), view.surfaces.begin(), view.surfaces.end());
      keypoints.insert(keypoints.end(), view.keypoints.begin(), view.keypoints.end());
      points.insert(points.end(), view.points.begin(), view.points.end());
      descriptors.insert(descriptors.end(), view.descriptors.begin(), view.descriptors.end());
      view_offsets.push_back(static_cast<std::uint32_t>(keypoints.size() / 4));
      for (const WeightedWord& entry : view.bag) {
        words.push_back(entry.word);
        weights.push_back(entry.weight);
      }
      bag_offsets.push_back(static_cast<std::uint32_t>(words.size()));
    }
  }
  Hdf5Writer file(path);
  file.WriteStrings("panorama_ids", ids);
  file.Write<std::uint32_t>("view_offsets", view_offsets);
  file.Write<std::uint32_t>("plane_offsets", plane_offsets);
  file.Write<float>("planes", planes, 4);
  file.Write<std::uint8_t>("surfaces", surfaces);
  file.Write<float>("keypoints", keypoints, 4);
  file.Write<float>("points_in_pano", points, 4);
  file.Write<std::uint8_t>("descriptors", descriptors, kDescriptorSize);
  file.Write<std::uint32_t>("bags/offsets", bag_offsets);
  file.Write<std::uint32_t>("bags/words", words);
  file.Write<float>("bags/weights", weights);
  file.Close();
  return static_cast<std::int64_t>(view_offsets.back());
}

BundlePart Describe(const fs::path& root, const std::string& path) {
  ThrowIfError(SyncPath(root / path));
  return {path, static_cast<std::uint64_t>(fs::file_size(root / path)),
          ValueOrThrow(Sha256OfFile(root / path))};
}

}  // namespace

Manifest WriteBundle(const fs::path& target, const BundleContent& content,
                     const FeaturesOfPanorama& features_of_panorama) {
  const Staging staging(target);
  Manifest manifest = content.manifest;
  manifest.parts.clear();
  WriteVocabulary(staging.path() / "vocabulary.h5", content.vocabulary);
  WriteGraph(staging.path() / "graph.h5", content);
  manifest.parts.push_back(Describe(staging.path(), "vocabulary.h5"));
  manifest.parts.push_back(Describe(staging.path(), "graph.h5"));
  manifest.num_features = 0;
  for (std::size_t begin = 0; begin < content.panoramas.size();) {
    if (CancelRequested())
      throw Error(ErrorCode::kCancelled, "stopped by the user; the next build resumes");
    std::size_t end = begin;
    const std::string& tile = content.tile_of_panorama[begin];
    while (end < content.panoramas.size() && content.tile_of_panorama[end] == tile) ++end;
    const std::string path = "tiles/" + tile + ".h5";
    manifest.num_features +=
        WriteTile(staging.path() / path, content, begin, end, features_of_panorama);
    manifest.parts.push_back(Describe(staging.path(), path));
    begin = end;
  }
  std::sort(manifest.parts.begin(), manifest.parts.end(),
            [](const BundlePart& a, const BundlePart& b) { return a.path < b.path; });
  manifest.num_panoramas = static_cast<std::int64_t>(content.panoramas.size());
  manifest.views_per_panorama = static_cast<int>(content.directions.size());
  manifest.num_views = manifest.num_panoramas * manifest.views_per_panorama;
  const std::string text = ToJson(manifest);
  ThrowIfError(WriteFileAtomically(staging.path() / kManifestName, text));
  // The layout of sha256sum, so that `sha256sum -c` checks it too.
  ThrowIfError(WriteFileAtomically(staging.path() / kManifestHashName,
                                   Sha256Hex(text) + "  " + kManifestName + "\n"));
  ThrowIfError(SyncPath(staging.path() / "tiles"));
  ThrowIfError(SyncPath(staging.path()));
  ThrowIfError(PublishDirectory(staging.path(), target));
  return manifest;
}

}  // namespace panofix
