#include "builder/publish/bundle_parts.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "common/io/hdf5_file.h"
#include "common/map/landmark_codes.h"
#include "common/map/landmark_words.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

void WriteTree(Hdf5Writer* file, const std::string& group, const VocabularyTree& tree, bool pack) {
  if (pack) {
    const std::size_t nodes = tree.centroids.size() / kDescriptorSize;
    std::vector<std::uint8_t> packed(nodes * kPackedDescriptorSize);
    for (std::size_t i = 0; i < nodes; ++i) {
      PackDescriptor(std::span<const std::uint8_t, kDescriptorSize>(
                         &tree.centroids[i * kDescriptorSize], kDescriptorSize),
                     &packed[i * kPackedDescriptorSize]);
    }
    file->Write<std::uint8_t>(group + "/centroids", packed, kPackedDescriptorSize);
  } else {
    file->Write<std::uint8_t>(group + "/centroids", tree.centroids, kDescriptorSize);
  }
  file->Write<std::uint32_t>(group + "/first_child", tree.first_child);
  file->Write<std::uint32_t>(group + "/num_children", tree.num_children);
  file->Write<std::uint32_t>(group + "/word", tree.word);
}

// Landmarks as columns, with those of each view.
void WriteLandmarks(Hdf5Writer* file, const BundleTile& tile, std::size_t first_view,
                    const BundleContent& content) {
  const bool pack = content.pack_descriptors;
  std::vector<float> points;
  std::vector<std::uint8_t> codes, descriptors;
  std::vector<std::vector<std::uint32_t>> of_view(tile.bags.size());
  for (std::uint32_t i = 0; i < tile.landmarks.size(); ++i) {
    const Landmark& landmark = tile.landmarks[i];
    const Eigen::Vector3f& at = landmark.point_in_pano;
    points.insert(points.end(), {at.x(), at.y(), at.z()});
    codes.insert(
        codes.end(),
        {EncodeLength(double{landmark.range_sigma_m}), EncodeLength(double{landmark.point_sigma_m}),
         EncodeLength(double{landmark.size_m}), EncodeAngle(double{landmark.angle_deg}),
         landmark.surface_idx, landmark.num_panoramas});
    const std::size_t begin = descriptors.size();
    if (pack) {
      descriptors.resize(begin + kPackedDescriptorSize);
      PackDescriptor(landmark.descriptor, &descriptors[begin]);
    } else {
      descriptors.insert(descriptors.end(), landmark.descriptor.begin(), landmark.descriptor.end());
    }
    for (const std::uint32_t view : landmark.views) of_view.at(view - first_view).push_back(i);
  }
  std::vector<std::uint32_t> offsets{0}, numbers;
  for (const auto& view : of_view) {
    numbers.insert(numbers.end(), view.begin(), view.end());
    offsets.push_back(static_cast<std::uint32_t>(numbers.size()));
  }
  file->Write<float>("landmarks/points_in_pano", points, 3);
  file->Write<std::uint8_t>("landmarks/codes", codes, 6);
  const int cols = pack ? kPackedDescriptorSize : kDescriptorSize;
  file->Write<std::uint8_t>("landmarks/descriptors", descriptors, cols);
  file->Write<std::uint32_t>("landmarks/words",
                             WordsOfDescriptors(content.vocabulary.sift, descriptors, cols));
  file->Write<std::uint32_t>("views/landmark_offsets", offsets);
  file->Write<std::uint32_t>("views/landmarks", numbers);
}

void WriteAnchors(Hdf5Writer* file, const BundleTile& tile, const BundleContent& content) {
  std::vector<std::string> ids;
  std::vector<std::uint32_t> landmark_offsets{0}, plane_offsets{0};
  std::vector<float> planes;
  std::size_t next = 0;
  for (const BundleTile::Anchor& anchor : tile.anchors) {
    ids.push_back(content.panoramas[anchor.panorama_idx].id);
    while (next < tile.landmarks.size() && tile.landmarks[next].panorama == anchor.panorama_idx)
      ++next;
    landmark_offsets.push_back(static_cast<std::uint32_t>(next));
    for (std::size_t i = 0; i < anchor.planes.size(); ++i) {
      const Eigen::Vector3f& n = anchor.planes[i].normal_in_pano;
      planes.insert(planes.end(), {n.x(), n.y(), n.z(), anchor.planes[i].d_m,
                                   anchor.distance_sigma_share[i], anchor.normal_sigma_rad[i]});
    }
    plane_offsets.push_back(static_cast<std::uint32_t>(planes.size() / 6));
  }
  if (next != tile.landmarks.size()) throw std::logic_error("landmarks do not follow the anchors");
  file->WriteStrings("anchors/panorama_ids", ids);
  file->Write<std::uint32_t>("anchors/landmark_offsets", landmark_offsets);
  file->Write<std::uint32_t>("anchors/plane_offsets", plane_offsets);
  file->Write<float>("anchors/planes", planes, 6);
}

void WriteBags(Hdf5Writer* file, const std::vector<BagOfWords>& bags) {
  std::vector<std::uint32_t> offsets{0}, words;
  std::vector<std::uint8_t> weights;
  for (const BagOfWords& bag : bags) {
    float largest = 0;
    for (const WeightedWord& entry : bag) largest = std::max(largest, entry.weight);
    for (const WeightedWord& entry : bag) {
      words.push_back(entry.word);
      // The length is made good again when read.
      weights.push_back(static_cast<std::uint8_t>(
          std::clamp(std::lround(255 * entry.weight / largest), 1L, 255L)));
    }
    offsets.push_back(static_cast<std::uint32_t>(words.size()));
  }
  file->Write<std::uint32_t>("bags/offsets", offsets);
  file->Write<std::uint32_t>("bags/words", words);
  file->Write<std::uint8_t>("bags/weights", weights);
}

}  // namespace

void WriteVocabulary(const fs::path& path, const Vocabulary& vocabulary, bool pack) {
  Hdf5Writer file(path);
  WriteTree(&file, "sift", vocabulary.sift, pack);
  WriteTree(&file, "mser", vocabulary.mser, pack);
  file.Write<float>("idf", vocabulary.idf);
  file.Close();
}

void WriteGraph(const fs::path& path, const BundleContent& content) {
  std::vector<std::string> ids;
  std::vector<double> geodetic, position, rotation, scale, directions;
  std::vector<std::uint8_t> has_depth, is_flagged;
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
    is_flagged.push_back(p.is_flagged ? 1 : 0);
    links.insert(links.end(), p.links.begin(), p.links.end());
    link_offsets.push_back(static_cast<std::uint32_t>(links.size()));
  }
  std::vector<std::uint32_t> owners;
  std::vector<float> station_positions;
  for (const MapStation& station : content.stations) {
    owners.push_back(station.panorama_idx);
    const Eigen::Vector3f at = station.position_in_pano.cast<float>();
    station_positions.insert(station_positions.end(), {at.x(), at.y(), at.z()});
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
  file.Write<std::uint8_t>("panoramas/is_flagged", is_flagged);
  file.Write<std::uint32_t>("panoramas/link_offsets", link_offsets);
  file.Write<std::uint32_t>("panoramas/links", links);
  file.Write<std::uint32_t>("stations/panorama", owners);
  file.Write<float>("stations/position_in_pano", station_positions, 3);
  file.Write<double>("views/direction_deg", directions, 2);
  file.Write<std::uint32_t>("similarity/offsets", content.similarity.offsets);
  file.Write<std::uint32_t>("similarity/views", content.similarity.views);
  file.Write<float>("similarity/cosine", content.similarity.similarity);
  file.Close();
}

void WriteTile(const fs::path& path, const BundleContent& content, std::size_t begin,
               std::size_t end, const BundleTile& tile) {
  std::vector<std::string> ids;
  for (std::size_t p = begin; p < end; ++p) ids.push_back(content.panoramas[p].id);
  std::size_t first_view = 0;
  while (first_view < content.stations.size() && content.stations[first_view].panorama_idx < begin)
    ++first_view;
  first_view *= content.directions.size();
  Hdf5Writer file(path);
  file.WriteStrings("panorama_ids", ids);
  WriteAnchors(&file, tile, content);
  WriteLandmarks(&file, tile, first_view, content);
  WriteBags(&file, tile.bags);
  file.Close();
}

void WriteViewImages(const fs::path& path, const BundleContent& content, std::size_t begin,
                     std::size_t end, const BundleTile& tile) {
  if (tile.view_images.size() != (end - begin) * content.directions.size())
    throw std::logic_error("view images do not follow the panoramas");
  std::vector<std::string> ids;
  for (std::size_t p = begin; p < end; ++p) ids.push_back(content.panoramas[p].id);
  std::vector<std::uint32_t> offsets{0};
  std::vector<std::uint8_t> bytes;
  for (const auto& image : tile.view_images) {
    bytes.insert(bytes.end(), image.begin(), image.end());
    if (bytes.size() > ~std::uint32_t{0})
      throw Error(ErrorCode::kTooLarge, path.string() + ": more than 4 GiB of view images");
    offsets.push_back(static_cast<std::uint32_t>(bytes.size()));
  }
  fs::create_directories(path.parent_path());
  Hdf5Writer file(path);
  file.WriteStrings("panorama_ids", ids);
  file.Write<std::uint32_t>("views/offsets", offsets);
  file.Write<std::uint8_t>("views/jpeg", bytes);
  file.Close();
}

}  // namespace panofix
