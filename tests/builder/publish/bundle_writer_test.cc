#include "builder/publish/bundle_writer.h"

#include <gtest/gtest.h>

#include <map>
#include <stdexcept>

#include "common/base/cancel.h"
#include "common/io/sha256.h"
#include "common/map/landmark_codes.h"
#include "tests/builder/publish/bundle_content.h"
#include "tests/common/io/temp_folder.h"
#include "tests/support/matchers.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

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

TEST(BundleParts, GraphOpensAsItWasWritten) {
  const TempFolder folder;
  const BundleContent content = Content();
  const Manifest manifest = Publish(folder / "b", content, GivenTile);
  const auto opened = MapBundle::Open(folder / "b");
  ASSERT_TRUE(opened.ok()) << opened.status().message();
  const MapBundle& bundle = **opened;
  EXPECT_EQ(ToJson(bundle.manifest()), ToJson(manifest));
  EXPECT_EQ(manifest.num_panoramas, 5);
  EXPECT_EQ(manifest.num_stations, 6);
  EXPECT_EQ(manifest.num_views, 12);
  EXPECT_EQ(manifest.views_per_station, 2);
  EXPECT_EQ(manifest.num_landmarks, (2 + 3) + (3 + 4 + 5 + 6));
  EXPECT_EQ(manifest.num_set_aside, 2);
  ASSERT_EQ(bundle.panoramas().size(), kPanoramas);
  for (std::uint32_t p = 0; p < kPanoramas; ++p) {
    const MapPanorama &actual = bundle.panoramas()[p], &expected = content.panoramas[p];
    EXPECT_EQ(actual.id, expected.id);
    EXPECT_EQ(actual.position.lat_deg, expected.position.lat_deg);
    EXPECT_THAT(actual.map_from_pano, Rigid3Near(expected.map_from_pano, 1e-7, 0));
    EXPECT_EQ(actual.point_scale, expected.point_scale);
    EXPECT_EQ(actual.links, expected.links);
    EXPECT_EQ(actual.has_depth, expected.has_depth);
    EXPECT_FALSE(actual.is_flagged);
    EXPECT_EQ(bundle.first_station(p), kFirstStation[p]);
  }
  ASSERT_EQ(bundle.stations().size(), 6U);
  for (std::size_t s = 0; s < 6; ++s) {
    EXPECT_EQ(bundle.stations()[s].panorama_idx, content.stations[s].panorama_idx);
    EXPECT_EQ(bundle.stations()[s].position_in_pano, content.stations[s].position_in_pano);
    for (std::size_t v = 0; v < 2; ++v) {
      const MapView& view = bundle.views()[2 * s + v];
      EXPECT_EQ(view.yaw_deg, content.directions[v].yaw_deg);
      EXPECT_EQ(view.pitch_deg, content.directions[v].pitch_deg);
      EXPECT_EQ(bundle.SimilarViews(2 * s + v)[0],
                2 * kFirstStation[(view.panorama_idx + 1) % kPanoramas] + v);
    }
  }
  // Words are packed as landmarks are: half a step, or what the largest code leaves out.
  const auto& centroids = content.vocabulary.sift.centroids;
  ASSERT_EQ(bundle.vocabulary().sift.centroids.size(), centroids.size());
  for (std::size_t i = 0; i < centroids.size(); ++i) {
    const int expected = std::min<int>(centroids[i], 15 * kDescriptorStep);
    EXPECT_NEAR(bundle.vocabulary().sift.centroids[i], expected, kDescriptorStep / 2) << i;
  }
  EXPECT_EQ(bundle.vocabulary().idf, content.vocabulary.idf);
}

// A tile's refinement moves and flags its panoramas; the graph is written after all tiles.
TEST(BundleParts, RefinedPosesAndFlagsAreInTheGraph) {
  const TempFolder folder;
  const BundleContent content = Content();
  (void)Publish(folder / "b", content,
                [](std::size_t begin, std::size_t end, std::vector<MapPanorama>* panoramas) {
                  for (std::size_t p = begin; p < end; ++p) {
                    (*panoramas)[p].map_from_pano.translation.z() += 1 + static_cast<double>(p);
                    (*panoramas)[p].is_flagged = p == 0 || p == 3;
                  }
                  return TileOf(begin, end);
                });
  const auto opened = MapBundle::Open(folder / "b");
  ASSERT_TRUE(opened.ok()) << opened.status().message();
  for (std::uint32_t p = 0; p < kPanoramas; ++p) {
    const MapPanorama& panorama = (*opened)->panoramas()[p];
    EXPECT_EQ(panorama.map_from_pano.translation.z(), 36.0 + p);
    EXPECT_EQ(panorama.is_flagged, p == 0 || p == 3);
  }
}

// Anything else would be written as another anchor's.
TEST(BundleParts, LandmarksThatDoNotFollowTheirAnchorsAreABug) {
  const TempFolder folder;
  EXPECT_THROW((void)Publish(folder / "b", Content(),
                             [](std::size_t begin, std::size_t end, std::vector<MapPanorama>*) {
                               BundleTile tile = TileOf(begin, end);
                               std::swap(tile.landmarks.front(), tile.landmarks.back());
                               return tile;
                             }),
               std::logic_error);
  EXPECT_EQ(NumEntries(folder.path()), 0U);
}

TEST(BundleParts, AViewOfAnotherTileIsABug) {
  const TempFolder folder;
  for (const std::uint32_t view : {std::uint32_t{5}, std::uint32_t{12}, ~std::uint32_t{0}}) {
    EXPECT_THROW((void)Publish(folder / "b", Content(),
                               [&](std::size_t begin, std::size_t end, std::vector<MapPanorama>*) {
                                 BundleTile tile = TileOf(begin, end);
                                 if (begin > 0) tile.landmarks.front().views = {view};
                                 return tile;
                               }),
                 std::logic_error)
        << view;
  }
  EXPECT_EQ(NumEntries(folder.path()), 0U);
}

TEST(PublishParts, ManifestNamesExactlyTheFilesThatAreThere) {
  const TempFolder folder;
  const Manifest manifest = Publish(folder / "b", Content(), GivenTile);
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

TEST(BundleParts, SameContentSameBytes) {
  const TempFolder folder;
  (void)Publish(folder / "a", Content(), GivenTile);
  (void)Publish(folder / "b", Content(), GivenTile);
  EXPECT_EQ(FilesOf(folder / "a"), FilesOf(folder / "b"));
}

// What changes in one place changes the tile of that place.
TEST(BundleParts, AnUnchangedTileIsByteIdentical) {
  const TempFolder folder;
  (void)Publish(folder / "a", Content(), GivenTile);
  (void)Publish(folder / "b", Content(),
                [](std::size_t begin, std::size_t end, std::vector<MapPanorama>*) {
                  BundleTile tile = TileOf(begin, end);
                  if (begin > 0) tile.landmarks.front().point_in_pano.x() += 1;
                  return tile;
                });
  auto a = FilesOf(folder / "a"), b = FilesOf(folder / "b");
  EXPECT_EQ(a["tiles/12022.h5"], b["tiles/12022.h5"]);
  EXPECT_EQ(a["graph.h5"], b["graph.h5"]);
  EXPECT_EQ(a["vocabulary.h5"], b["vocabulary.h5"]);
  EXPECT_NE(a["tiles/12023.h5"], b["tiles/12023.h5"]);
}

TEST(PublishParts, ReplacesABundleThatIsThere) {
  const TempFolder folder;
  BundleContent content = Content();
  (void)Publish(folder / "b", content, GivenTile);
  content.manifest.name = "newer";
  // With the slash that a shell's completion leaves.
  (void)Publish((folder / "b").string() + "/", content, GivenTile);
  const auto opened = MapBundle::Open(folder / "b");
  ASSERT_TRUE(opened.ok()) << opened.status().message();
  EXPECT_EQ((*opened)->manifest().name, "newer");
  EXPECT_EQ(NumEntries(folder.path()), 1U);
  EXPECT_EQ(NumEntries(folder / "b"), 5U);
}

TEST(PublishParts, ALostSignatureIsLogged) {
  const TempFolder folder;
  const auto log_of_publishing = [&] {
    testing::internal::CaptureStderr();
    static_cast<void>(Publish(folder / "b", Content(), GivenTile));
    return testing::internal::GetCapturedStderr();
  };
  EXPECT_EQ(log_of_publishing().find("was signed"), std::string::npos);
  WriteText(folder / "b" / kManifestSignatureName, "signature");
  EXPECT_NE(log_of_publishing().find("was signed"), std::string::npos);
  EXPECT_FALSE(fs::exists(folder / "b" / kManifestSignatureName));
}

TEST(PublishParts, AFailureLeavesTheOldBundleAndNothingElse) {
  const TempFolder folder;
  (void)Publish(folder / "b", Content(), GivenTile);
  const auto before = FilesOf(folder / "b");
  const WrittenParts written(Content(), GivenTile);
  const auto expect_fails = [&](ErrorCode code) {
    for (const char* name : {"b", "new"}) {
      try {
        (void)PublishParts(folder / name, written.manifest, written.parts);
        ADD_FAILURE() << "nothing was thrown";
      } catch (const Error& error) {
        EXPECT_EQ(error.code(), code) << error.what();
      }
    }
    EXPECT_EQ(FilesOf(folder / "b"), before);
    EXPECT_EQ(NumEntries(folder.path()), 1U);
  };
  // The last part in the list: the others are staged by then.
  const fs::path last = written.parts.back().file;
  WriteText(last, ReadText(last) + "x");
  expect_fails(ErrorCode::kChecksumMismatch);
  fs::remove(last);
  expect_fails(ErrorCode::kIo);
}

// Bytes that tell the views apart; whether they are pictures is not the writer's business.
BundleTile TileWithImages(std::size_t begin, std::size_t end, std::vector<MapPanorama>*) {
  BundleTile tile = TileOf(begin, end);
  for (std::size_t view = 2 * begin; view < 2 * end; ++view)
    tile.view_images.emplace_back(1 + view, static_cast<std::uint8_t>(view));
  return tile;
}

TEST(BundleParts, ViewImagesAreKeptInPartsOfTheirOwn) {
  const TempFolder folder;
  const Manifest manifest = Publish(folder / "b", Content(), TileWithImages);
  const Manifest without = Publish(folder / "without", Content(), GivenTile);
  EXPECT_EQ(manifest.parts.size(), without.parts.size() + 2);
  std::uint8_t view = 0;
  for (const char* part : {"12022", "12023"}) {
    const fs::path path = folder / "b" / "images" / (std::string(part) + ".h5");
    const Hdf5Reader file = ValueOrThrow(Hdf5Reader::Open(path));
    const auto offsets = ValueOrThrow(file.Read<std::uint32_t>("views/offsets"));
    const auto bytes = ValueOrThrow(file.Read<std::uint8_t>("views/jpeg"));
    for (std::size_t row = 0; row + 1 < offsets.values.size(); ++row, ++view) {
      ASSERT_EQ(offsets.values[row + 1] - offsets.values[row], 1U + view);
      EXPECT_EQ(bytes.values[offsets.values[row]], view);
    }
  }
  EXPECT_EQ(view, 2 * kPanoramas);
  const auto bundle = MapBundle::Open(folder / "b");
  ASSERT_TRUE(bundle.ok()) << bundle.status().message();
  EXPECT_TRUE((*bundle)->has_view_images());
  EXPECT_EQ((*bundle)->ViewImage(0).status().code(), ErrorCode::kBadData);  // no pictures, these
}

TEST(BundleParts, ViewImagesOfTheWrongNumberAreACallersFault) {
  const TempFolder folder;
  const auto make_tile = [](std::size_t begin, std::size_t end, std::vector<MapPanorama>* all) {
    BundleTile tile = TileWithImages(begin, end, all);
    tile.view_images.pop_back();
    return tile;
  };
  EXPECT_THROW((void)Publish(folder / "b", Content(), make_tile), std::logic_error);
  EXPECT_EQ(NumEntries(folder.path()), 0U);
}

TEST(PublishParts, CtrlCLeavesNothing) {
  const TempFolder folder;
  try {
    (void)Publish(folder / "b", Content(),
                  [](std::size_t begin, std::size_t end, std::vector<MapPanorama>*) {
                    RequestCancel();
                    return TileOf(begin, end);
                  });
    ADD_FAILURE() << "nothing was thrown";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::kCancelled);
  }
  ClearCancel();
  EXPECT_EQ(NumEntries(folder.path()), 0U);
}

TEST(PublishParts, APlaceThatCannotBeWrittenIsSaid) {
  const TempFolder folder;
  WriteText(folder / "file", "x");
  EXPECT_THROW((void)Publish(folder / "file" / "b", Content(), GivenTile), Error);
  EXPECT_THROW((void)Publish(folder / "file", Content(), GivenTile), Error);
  EXPECT_EQ(ReadText(folder / "file"), "x");
}

// The corruption tests over the builder's own bytes; every region in tests/common/map.
TEST(PublishParts, FlippedTruncatedAndMissingPartsDoNotOpen) {
  const TempFolder folder;
  const Manifest manifest = Publish(folder / "b", Content(), GivenTile);
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
