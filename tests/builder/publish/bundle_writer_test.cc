#include "builder/publish/bundle_writer.h"

#include <gtest/gtest.h>

#include <map>

#include "common/base/cancel.h"
#include "common/io/sha256.h"
#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"
#include "tests/common/vocabulary/make_tree.h"
#include "tests/support/matchers.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kPanoramas = 5;

BundleContent Content() {
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
    for (std::uint32_t v = 0; v < 2; ++v) {
      content.similarity.views.push_back((2 * p + v + 1) % 10);
      content.similarity.similarity.push_back(0.5F);
      content.similarity.offsets.push_back(
          static_cast<std::uint32_t>(content.similarity.views.size()));
    }
  }
  return content;
}

// Panorama p has p + v features in view v.
BundlePanorama FeaturesOf(std::size_t p) {
  Rng rng(p, "tests/features");
  BundlePanorama panorama;
  panorama.planes = {0, 0, 0, 0, 0, 0, -1, 2.5F};
  for (std::size_t v = 0; v < 2; ++v) {
    BundleView view;
    const std::size_t count = p + v;
    for (std::size_t i = 0; i < 4 * count; ++i) {
      view.keypoints.push_back(static_cast<float>(rng.Uniform(0, 200)));
      view.points.push_back(static_cast<float>(rng.Uniform(-9, 9)));
    }
    view.surfaces.assign(count, 1);
    view.descriptors = RandomDescriptors(count, &rng);
    view.bag = {{static_cast<std::uint32_t>(p), 0.6F}, {static_cast<std::uint32_t>(40 + v), 0.8F}};
    panorama.views.push_back(view);
  }
  return panorama;
}

std::map<std::string, std::string> FilesOf(const fs::path& folder) {
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file())
      files[fs::relative(entry.path(), folder).string()] = ReadText(entry.path());
  }
  return files;
}

std::size_t NumEntries(const fs::path& folder) {
  const fs::directory_iterator entries(folder);
  return static_cast<std::size_t>(std::distance(begin(entries), end(entries)));
}

TEST(WriteBundle, OpensAsItWasWritten) {
  const TempFolder folder;
  const BundleContent content = Content();
  const Manifest manifest = WriteBundle(folder / "b", content, FeaturesOf);
  const auto opened = MapBundle::Open(folder / "b");
  ASSERT_TRUE(opened.ok()) << opened.status().message();
  const MapBundle& bundle = **opened;
  EXPECT_EQ(ToJson(bundle.manifest()), ToJson(manifest));
  EXPECT_EQ(manifest.num_panoramas, 5);
  EXPECT_EQ(manifest.num_views, 10);
  EXPECT_EQ(manifest.views_per_panorama, 2);
  EXPECT_EQ(manifest.num_features, 0 + 1 + 1 + 2 + 2 + 3 + 3 + 4 + 4 + 5);
  EXPECT_EQ(manifest.num_set_aside, 2);
  ASSERT_EQ(bundle.panoramas().size(), kPanoramas);
  for (std::size_t p = 0; p < kPanoramas; ++p) {
    const MapPanorama &actual = bundle.panoramas()[p], &expected = content.panoramas[p];
    EXPECT_EQ(actual.id, expected.id);
    EXPECT_EQ(actual.position.lat_deg, expected.position.lat_deg);
    EXPECT_THAT(actual.map_from_pano, Rigid3Near(expected.map_from_pano, 1e-7, 0));
    EXPECT_EQ(actual.point_scale, expected.point_scale);
    EXPECT_EQ(actual.links, expected.links);
    EXPECT_EQ(actual.has_depth, expected.has_depth);
    EXPECT_EQ(bundle.SurfaceNormal(p, 1), Eigen::Vector3d(0, 0, -1));
    const BundlePanorama written = FeaturesOf(p);
    for (std::size_t v = 0; v < 2; ++v) {
      const std::size_t view = 2 * p + v;
      const ViewFeatures features = bundle.Features(view);
      const BundleView& w = written.views[v];
      EXPECT_TRUE(std::equal(features.keypoints.begin(), features.keypoints.end(),
                             w.keypoints.begin(), w.keypoints.end()));
      EXPECT_TRUE(std::equal(features.points_in_pano.begin(), features.points_in_pano.end(),
                             w.points.begin(), w.points.end()));
      EXPECT_TRUE(std::equal(features.surfaces.begin(), features.surfaces.end(), w.surfaces.begin(),
                             w.surfaces.end()));
      EXPECT_TRUE(std::equal(features.descriptors.begin(), features.descriptors.end(),
                             w.descriptors.begin(), w.descriptors.end()));
      ASSERT_EQ(bundle.bags()[view].size(), 2U);
      EXPECT_EQ(bundle.bags()[view][0].word, p);
      EXPECT_EQ(bundle.views()[view].yaw_deg, content.directions[v].yaw_deg);
      EXPECT_EQ(bundle.SimilarViews(view)[0], (view + 1) % 10);
    }
  }
  EXPECT_EQ(bundle.vocabulary().sift.centroids, content.vocabulary.sift.centroids);
  EXPECT_EQ(bundle.vocabulary().idf, content.vocabulary.idf);
}

TEST(WriteBundle, ManifestNamesExactlyTheFilesThatAreThere) {
  const TempFolder folder;
  const Manifest manifest = WriteBundle(folder / "b", Content(), FeaturesOf);
  auto files = FilesOf(folder / "b");
  EXPECT_EQ(manifest.parts.size(), 4U);
  std::string previous;
  for (const BundlePart& part : manifest.parts) {
    EXPECT_LT(previous, part.path);
    previous = part.path;
    ASSERT_EQ(files.count(part.path), 1U) << part.path;
    EXPECT_EQ(part.num_bytes, files[part.path].size());
    EXPECT_EQ(part.sha256, Sha256Hex(files[part.path]));
    files.erase(part.path);
  }
  // The layout of sha256sum.
  EXPECT_EQ(files[kManifestHashName], Sha256Hex(files[kManifestName]) + "  manifest.json\n");
  EXPECT_EQ(files.size(), 2U);
}

TEST(WriteBundle, SameContentSameBytes) {
  const TempFolder folder;
  (void)WriteBundle(folder / "a", Content(), FeaturesOf);
  (void)WriteBundle(folder / "b", Content(), FeaturesOf);
  EXPECT_EQ(FilesOf(folder / "a"), FilesOf(folder / "b"));
}

// What changes in one place changes the tile of that place.
TEST(WriteBundle, AnUnchangedTileIsByteIdentical) {
  const TempFolder folder;
  (void)WriteBundle(folder / "a", Content(), FeaturesOf);
  (void)WriteBundle(folder / "b", Content(), [](std::size_t p) {
    BundlePanorama panorama = FeaturesOf(p);
    if (p == 4) panorama.views[0].points[0] += 1;
    return panorama;
  });
  auto a = FilesOf(folder / "a"), b = FilesOf(folder / "b");
  EXPECT_EQ(a["tiles/12022.h5"], b["tiles/12022.h5"]);
  EXPECT_EQ(a["graph.h5"], b["graph.h5"]);
  EXPECT_EQ(a["vocabulary.h5"], b["vocabulary.h5"]);
  EXPECT_NE(a["tiles/12023.h5"], b["tiles/12023.h5"]);
}

TEST(WriteBundle, ReplacesABundleThatIsThere) {
  const TempFolder folder;
  BundleContent content = Content();
  (void)WriteBundle(folder / "b", content, FeaturesOf);
  content.manifest.name = "newer";
  // With the slash that a shell's completion leaves.
  (void)WriteBundle((folder / "b").string() + "/", content, FeaturesOf);
  const auto opened = MapBundle::Open(folder / "b");
  ASSERT_TRUE(opened.ok()) << opened.status().message();
  EXPECT_EQ((*opened)->manifest().name, "newer");
  EXPECT_EQ(NumEntries(folder.path()), 1U);
  EXPECT_EQ(NumEntries(folder / "b"), 5U);
}

TEST(WriteBundle, AFailureLeavesTheOldBundleAndNothingElse) {
  const TempFolder folder;
  (void)WriteBundle(folder / "b", Content(), FeaturesOf);
  const auto before = FilesOf(folder / "b");
  const auto failing = [](std::size_t p) -> BundlePanorama {
    if (p == 3) throw Error(ErrorCode::kIo, "disk: gone");
    return FeaturesOf(p);
  };
  EXPECT_THROW((void)WriteBundle(folder / "b", Content(), failing), Error);
  EXPECT_EQ(FilesOf(folder / "b"), before);
  EXPECT_EQ(NumEntries(folder.path()), 1U);
  EXPECT_THROW((void)WriteBundle(folder / "new", Content(), failing), Error);
  EXPECT_FALSE(fs::exists(folder / "new"));
  EXPECT_EQ(NumEntries(folder.path()), 1U);
}

TEST(WriteBundle, CtrlCLeavesNothing) {
  const TempFolder folder;
  try {
    (void)WriteBundle(folder / "b", Content(), [](std::size_t p) {
      RequestCancel();
      return FeaturesOf(p);
    });
    ADD_FAILURE() << "nothing was thrown";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::kCancelled);
  }
  ClearCancel();
  EXPECT_EQ(NumEntries(folder.path()), 0U);
}

TEST(WriteBundle, APlaceThatCannotBeWrittenIsSaid) {
  const TempFolder folder;
  WriteText(folder / "file", "x");
  EXPECT_THROW((void)WriteBundle(folder / "file" / "b", Content(), FeaturesOf), Error);
  EXPECT_THROW((void)WriteBundle(folder / "file", Content(), FeaturesOf), Error);
  EXPECT_EQ(ReadText(folder / "file"), "x");
}

// The corruption tests over the builder's own bytes; every region in tests/common/map.
TEST(WriteBundle, FlippedTruncatedAndMissingPartsDoNotOpen) {
  const TempFolder folder;
  const Manifest manifest = WriteBundle(folder / "b", Content(), FeaturesOf);
  Rng rng(1, "tests/corrupt");
  for (const BundlePart& part : manifest.parts) {
    const fs::path path = folder / "b" / part.path;
    const std::string good = ReadText(path);
    for (int i = 0; i < 25; ++i) {
      std::string bad = good;
      const std::size_t at = rng.Below(bad.size());
      bad[at] = static_cast<char>(bad[at] ^ (1 << rng.Below(8)));
      WriteText(path, bad);
      EXPECT_EQ(MapBundle::Open(folder / "b").status().code(), ErrorCode::kChecksumMismatch)
          << part.path << " " << at;
    }
    WriteText(path, good.substr(0, good.size() - 1));
    EXPECT_EQ(MapBundle::Open(folder / "b").status().code(), ErrorCode::kChecksumMismatch)
        << part.path;
    fs::remove(path);
    EXPECT_EQ(MapBundle::Open(folder / "b").status().code(), ErrorCode::kNotFound) << part.path;
    WriteText(path, good);
  }
  EXPECT_TRUE(MapBundle::Open(folder / "b").ok());
}

}  // namespace
}  // namespace panofix
