// What schemas/README.md promises of migration, on the bundles of schemas/golden.
#include "builder/publish/migrate.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

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

TEST_F(Migrate, TwoZeroBecomesTwoOneWithTheSameParts) {
  const fs::path old = Copy("bundle-2.0");
  WriteText(old / kManifestSignatureName, "whatever it was");
  const Manifest manifest = MigrateBundle(old, out_, {});
  const auto bundle = MapBundle::Open(out_);
  ASSERT_TRUE(bundle.ok()) << bundle.status().message();
  EXPECT_EQ((*bundle)->manifest().minor, 1);
  EXPECT_EQ((*bundle)->manifest().build, 7);
  EXPECT_EQ((*bundle)->num_landmarks(), MapBundle::Open(old).value()->num_landmarks());
  EXPECT_FALSE(fs::exists(out_ / kManifestSignatureName)) << "an old signature is of another map";
  for (const BundlePart& part : manifest.parts)
    EXPECT_TRUE(ReadText(old / part.path) == ReadText(out_ / part.path)) << part.path;
  // The manifest is the one that the release with 2.1 wrote, but for what the builds made anew.
  Json expected = ReadManifest(kGolden / "bundle-2.1");
  const Json before = ReadManifest(old);
  expected["provenance"]["data_set_sha256"] = before["provenance"]["data_set_sha256"];
  expected["parts"] = before["parts"];
  EXPECT_EQ(ReadText(out_ / kManifestName), expected.dump(1) + "\n");
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
  ExpectRefused(Copy("bundle-2.1"), ErrorCode::kInvalidArgument, "nothing to migrate");
}

TEST_F(Migrate, NewerFormatsDoNotGoBack) {
  const fs::path old = Copy("bundle-2.1");
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
  std::string graph = ReadText(old / "graph.h5");
  graph[graph.size() / 2] = static_cast<char>(graph[graph.size() / 2] ^ 1);
  WriteText(old / "graph.h5", graph);
  ExpectRefused(old, ErrorCode::kChecksumMismatch, "graph.h5");
  fs::remove(old / "graph.h5");
  ExpectRefused(old, ErrorCode::kIo, "graph.h5");
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
