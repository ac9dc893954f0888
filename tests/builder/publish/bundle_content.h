#pragma once
// A small bundle as the builder's stages would make it, and its way to disk: part by part, then
// published.

#include <algorithm>
#include <cstdint>
#include <functional>
#include <vector>

#include "builder/publish/bundle_parts.h"
#include "builder/publish/bundle_writer.h"
#include "common/io/sha256.h"
#include "common/map/vocabulary_file.h"
#include "tests/common/io/temp_folder.h"
#include "tests/common/vocabulary/make_tree.h"

namespace panofix {

inline constexpr std::uint32_t kPanoramas = 5;
inline constexpr std::uint32_t kFirstStation[] = {0, 1, 3,
                                                  4, 5, 6};  // panorama 1 has a virtual one

inline BundleContent Content() {
  Rng rng(1, "tests/publish");
  BundleContent content;
  content.manifest.name = "written";
  content.manifest.generator = "tests";
  content.manifest.map_frame = MapFrame::Tangent({48.85, 2.335, 0}).parameters();
  content.manifest.camera = Camera::FromHorizontalFov(320, 240, 70);
  content.manifest.provenance.source = "tests";
  content.manifest.num_set_aside = 2;
  content.directions = RingOfViews(2, 10);
  content.vocabulary = RandomVocabulary(&rng);
  content.similarity.offsets = {0};
  for (std::uint32_t p = 0; p < kPanoramas; ++p) {
    MapPanorama panorama;
    panorama.id = "pano" + std::to_string(p);
    panorama.position = {48.85 + 1e-4 * p, 2.335, 35};
    panorama.map_from_pano = {Eigen::Quaterniond(0.8, 0, 0, 0.6), Eigen::Vector3d(p, 11.0 * p, 35)};
    panorama.point_scale = 1 + 1e-6 * p;
    panorama.has_depth = p != 1;
    if (p > 0) panorama.links.push_back(p - 1);
    if (p + 1 < kPanoramas) panorama.links.push_back(p + 1);
    content.panoramas.push_back(panorama);
    content.tile_of_panorama.push_back(p < 2 ? "12022" : "12023");
    content.stations.push_back({p, Eigen::Vector3d::Zero()});
    if (p == 1) content.stations.push_back({p, {1.5, -4, 0.25}});
    for (std::uint32_t v = 0; v < 2; ++v) {
      content.similarity.views.push_back(2 * kFirstStation[(p + 1) % kPanoramas] + v);
      content.similarity.similarity.push_back(0.5F);
      content.similarity.offsets.push_back(
          static_cast<std::uint32_t>(content.similarity.views.size()));
    }
  }
  return content;
}

// Landmarks anchored at panorama `anchor`: its number and two more, shown by views of the tile.
inline void AddAnchor(std::uint32_t anchor, std::uint32_t first_view, std::uint32_t num_views,
                      BundleTile* tile) {
  Rng rng(anchor, "tests/landmarks");
  for (std::uint32_t i = 0; i < 2 + anchor; ++i) {
    Landmark landmark;
    landmark.panorama = anchor;
    const auto value = [&](double low, double high) {
      return static_cast<float>(rng.Uniform(low, high));
    };
    landmark.point_in_pano = {value(-9, 9), value(-9, 9), value(-9, 9)};
    landmark.range_sigma_m = value(0.05, 2), landmark.point_sigma_m = value(0.01, 0.1);
    landmark.surface_idx = 1, landmark.size_m = value(0.05, 1), landmark.angle_deg = value(0, 360);
    landmark.num_panoramas = static_cast<std::uint8_t>(1 + i);
    for (auto& byte : landmark.descriptor) byte = static_cast<std::uint8_t>(rng.Below(155));
    for (std::uint32_t v = 0; v < num_views; ++v) {
      if ((v + i) % 3 != 0) landmark.views.push_back(first_view + v);
    }
    tile->landmarks.push_back(landmark);
  }
  tile->anchors.push_back({anchor,
                           {{{0, 0, 0}, 0}, {{0, 0, -1}, 2.5F}},
                           {0, 0.01F * static_cast<float>(1 + anchor)},
                           {0, 0.002F}});
}

// The tile of panoramas [begin, end), with a landmark of the panorama before across its border.
inline BundleTile TileOf(std::size_t begin, std::size_t end) {
  const std::uint32_t first_view = 2 * kFirstStation[begin],
                      num_views = 2 * kFirstStation[end] - first_view;
  BundleTile tile;
  for (std::size_t p = begin > 0 ? begin - 1 : 0; p < end; ++p)
    AddAnchor(static_cast<std::uint32_t>(p), first_view, num_views, &tile);
  for (std::uint32_t v = 0; v < num_views; ++v)
    tile.bags.push_back({{first_view + v, 0.6F}, {40 + v % 2, 0.8F}});
  return tile;
}

inline BundleTile GivenTile(std::size_t begin, std::size_t end, std::vector<MapPanorama>*) {
  return TileOf(begin, end);
}

// Makes the tile of panoramas [begin, end); may refine the panoramas' poses.
using MakeTile =
    std::function<BundleTile(std::size_t begin, std::size_t end, std::vector<MapPanorama>*)>;

// Parts in a folder of their own, as the stages leave them.
class WrittenParts {
 public:
  WrittenParts(BundleContent content, const MakeTile& make_tile) {
    manifest = content.manifest;
    Add("vocabulary.h5", [&](const auto& path) {
      WriteVocabulary(path, content.vocabulary, content.pack_descriptors);
    });
    manifest.vocabulary_release = "sha256:" + manifest.parts.back().sha256;
    // As the stages have it: from its file.
    const auto file = ValueOrThrow(Hdf5Reader::Open(folder_ / "vocabulary.h5"));
    content.vocabulary = ValueOrThrow(ReadVocabulary(file));
    for (std::size_t begin = 0; begin < content.panoramas.size();) {
      std::size_t end = begin;
      const std::string& tile = content.tile_of_panorama[begin];
      while (end < content.panoramas.size() && content.tile_of_panorama[end] == tile) ++end;
      const BundleTile made = make_tile(begin, end, &content.panoramas);
      manifest.num_landmarks += static_cast<std::int64_t>(made.landmarks.size());
      Add("tiles/" + tile + ".h5",
          [&](const auto& path) { WriteTile(path, content, begin, end, made); });
      if (!made.view_images.empty()) {
        Add("images/" + tile + ".h5",
            [&](const auto& path) { WriteViewImages(path, content, begin, end, made); });
      }
      begin = end;
    }
    Add("graph.h5", [&](const auto& path) { WriteGraph(path, content); });
    const auto by_path = [](const auto& a, const auto& b) { return a.path < b.path; };
    std::sort(manifest.parts.begin(), manifest.parts.end(), by_path);
    manifest.num_panoramas = static_cast<std::int64_t>(content.panoramas.size());
    manifest.views_per_station = static_cast<int>(content.directions.size());
    manifest.num_stations = static_cast<std::int64_t>(content.stations.size());
    manifest.num_views = manifest.num_stations * manifest.views_per_station;
    for (const BundlePart& part : manifest.parts) parts.push_back({part, folder_ / part.path});
  }

  Manifest manifest;
  std::vector<FinishedPart> parts;

 private:
  void Add(const std::string& name,
           const std::function<void(const std::filesystem::path&)>& write) {
    const std::filesystem::path path = folder_ / name;
    std::filesystem::create_directories(path.parent_path());
    write(path);
    manifest.parts.push_back(
        {name, std::filesystem::file_size(path), ValueOrThrow(Sha256OfFile(path))});
  }
  const TempFolder folder_;
};

inline Manifest Publish(const std::filesystem::path& target, const BundleContent& content,
                        const MakeTile& make_tile) {
  const WrittenParts written(content, make_tile);
  return PublishParts(target, written.manifest, written.parts);
}

}  // namespace panofix
