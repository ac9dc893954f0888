// What schemas/README.md promises of migration, on the bundles of schemas/golden.
#include "builder/publish/migrate.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <span>

#include "common/io/hdf5_file.h"
#include "common/map/map_bundle.h"
#include "tests/common/io/temp_folder.h"
#include "tests/common/map/crafted_bundle.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

const fs::path kGolden = fs::path(PANOFIX_SOURCE_DIR) / "schemas/golden";

Json ReadManifest(const fs::path& bundle) { return Json::parse(ReadText(bundle / kManifestName)); }

class Migrate : public testing::Test {
 protected:
  fs::path Copy(const std::string& golden) {
    fs::copy(kGolden / golden, folder_ / "old", fs::copy_options::recursive);
    return folder_ / "old";
  }
  void ChangeFormat(const fs::path& bundle, const std::string& member, int value) {
    Json json = ReadManifest(bundle);
    json["format"][member] = value;
    WriteText(bundle / kManifestName, json.dump(1) + "\n");
    SealManifest(bundle);
  }
  // Refused with this code and word, and nothing left behind.
  void ExpectRefused(const fs::path& from, ErrorCode code, const std::string& word,
                     std::optional<std::int64_t> build = {}) {
    try {
      (void)MigrateBundle(from, out_, build);
      ADD_FAILURE() << from << " was migrated";
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), code) << error.what();
      EXPECT_NE(std::string(error.what()).find(word), std::string::npos) << error.what();
    }
    for (const auto& entry : fs::directory_iterator(folder_.path()))
      EXPECT_EQ(entry.path().filename(), "old");
  }
  const TempFolder folder_;
  const fs::path out_ = folder_ / "new";
};

// Every array of a tile of 2.1 as its bytes.
std::vector<std::string> ArraysOf(const fs::path& tile) {
  const Hdf5Reader file = ValueOrThrow(Hdf5Reader::Open(tile));
  std::vector<std::string> arrays;
  const auto add = [&]<typename T>(T /*type*/, const std::string& name) {
    const auto array = ValueOrThrow(file.Read<T>(name, -1));
    const auto bytes = std::as_bytes(array.values);
    arrays.push_back(name + " " + std::to_string(array.rows) + "x" + std::to_string(array.cols) +
                     " " + std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
  };
  for (const char* name : {"panorama_ids", "anchors/panorama_ids", "landmarks/codes",
                           "landmarks/descriptors", "bags/weights"})
    add(std::uint8_t{}, name);
  for (const char* name :
       {"anchors/landmark_offsets", "anchors/plane_offsets", "views/landmark_offsets",
        "views/landmarks", "bags/offsets", "bags/words"})
    add(std::uint32_t{}, name);
  for (const char* name : {"anchors/planes", "landmarks/points_in_pano"}) add(float{}, name);
  return arrays;
}

TEST_F(Migrate, TwoZeroBecomesTwoTwoWithTheSameArrays) {
  const fs::path old = Copy("bundle-2.0");
  WriteText(old / kManifestSignatureName, "whatever it was");
  const Manifest manifest = MigrateBundle(old, out_, {});
  const auto bundle = MapBundle::Open(out_);
  ASSERT_TRUE(bundle.ok()) << bundle.status().message();
  EXPECT_EQ((*bundle)->manifest().minor, 2);
  EXPECT_EQ((*bundle)->manifest().build, 7);
  EXPECT_EQ((*bundle)->num_landmarks(), MapBundle::Open(old).value()->num_landmarks());
  EXPECT_FALSE(fs::exists(out_ / kManifestSignatureName)) << "an old signature is of another map";
  ASSERT_EQ(manifest.parts.size(), 3U);
  for (const BundlePart& part : manifest.parts) {
    const bool is_tile = part.path.starts_with("tiles/");
    EXPECT_NE(is_tile, ReadText(old / part.path) == ReadText(out_ / part.path)) << part.path;
    if (is_tile) {
      EXPECT_TRUE(ArraysOf(old / part.path) == ArraysOf(out_ / part.path));
    }
  }
  // The golden bundle of 2.2 was built from the panoramas of that of 2.0.
  EXPECT_EQ(ReadText(out_ / kManifestName), ReadText(kGolden / "bundle-2.2" / kManifestName));
}

TEST_F(Migrate, TwoOneGetsTheWordsOfItsLandmarks) {
  const fs::path old = Copy("bundle-2.1");
  (void)MigrateBundle(old, out_, {});
  const auto bundle = MapBundle::Open(out_);
  ASSERT_TRUE(bundle.ok()) << bundle.status().message();
  EXPECT_EQ((*bundle)->manifest().minor, 2);
  EXPECT_EQ((*bundle)->manifest().vocabulary_release,
            ReadManifest(old)["vocabulary_release"].get<std::string>());
  const MapTile& tile = (*bundle)->tiles().Get(0);
  ASSERT_EQ(tile.words().size(), tile.num_landmarks());
  for (std::size_t i = 0; i < tile.num_landmarks(); ++i) {
    std::uint8_t descriptor[kDescriptorSize];
    tile.Descriptor(i, descriptor);
    EXPECT_EQ(tile.words()[i], (*bundle)->vocabulary().sift.Quantize(descriptor)) << i;
  }
}

TEST_F(Migrate, SameBytesTwiceAndANumberOfItsOwnWhereAsked) {
  const fs::path old = Copy("bundle-2.0");
  (void)MigrateBundle(old, out_, {});
  (void)MigrateBundle(old, folder_ / "again", {});
  EXPECT_EQ(ReadText(out_ / kManifestName), ReadText(folder_ / "again" / kManifestName));
  EXPECT_EQ(MigrateBundle(old, folder_ / "next", 8).build, 8);
  EXPECT_EQ(ReadManifest(folder_ / "next")["build"], 8);
}

TEST_F(Migrate, FormatOneIsBuiltAgain) {
  ExpectRefused(Copy("bundle-1.0"), ErrorCode::kUnsupportedVersion, "made from the panoramas");
}

TEST_F(Migrate, TheCurrentFormatNeedsNone) {
  ExpectRefused(Copy("bundle-2.2"), ErrorCode::kInvalidArgument, "nothing to migrate");
}

TEST_F(Migrate, NewerFormatsDoNotGoBack) {
  const fs::path old = Copy("bundle-2.2");
  ChangeFormat(old, "minor", kBundleMinor + 1);
  ExpectRefused(old, ErrorCode::kUnsupportedVersion, "nothing leads back");
  ChangeFormat(old, "major", kBundleMajor + 1);
  ExpectRefused(old, ErrorCode::kUnsupportedVersion, "update panofix");
}

TEST_F(Migrate, NumbersOnlyGrow) {
  ExpectRefused(Copy("bundle-2.0"), ErrorCode::kInvalidArgument, "only grow", 6);
}

TEST_F(Migrate, WhatIsThereIsNotReplaced) {
  const fs::path old = Copy("bundle-2.0");
  EXPECT_THROW((void)MigrateBundle(old, old, {}), Error);
  EXPECT_TRUE(MapBundle::Open(old).ok());
}

TEST_F(Migrate, ADamagedPartIsNotCarriedOver) {
  const fs::path old = Copy("bundle-2.0");
  // The tile is read, the graph moved.
  for (const char* part : {"tiles/12022001102001020.h5", "graph.h5"}) {
    std::string bytes = ReadText(old / part);
    bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 1);
    WriteText(old / part, bytes);
    ExpectRefused(old, ErrorCode::kChecksumMismatch, part);
    WriteText(old / part, ReadText(kGolden / "bundle-2.0" / part));
    fs::remove(old / part);
    ExpectRefused(old, part[0] == 't' ? ErrorCode::kNotFound : ErrorCode::kIo, part);
    fs::copy_file(kGolden / "bundle-2.0" / part, old / part);
  }
}

TEST_F(Migrate, ABundleWithoutAVocabularyIsNone) {
  const fs::path old = Copy("bundle-2.0");
  Json json = ReadManifest(old);
  json["parts"].erase(2);
  WriteText(old / kManifestName, json.dump(1) + "\n");
  SealManifest(old);
  ExpectRefused(old, ErrorCode::kBadData, "vocabulary.h5");
}

}  // namespace
}  // namespace panofix
