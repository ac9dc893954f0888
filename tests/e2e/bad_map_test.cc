// Damaged bundles and bent drives, through both programs.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/drive/poses_csv.h"
#include "common/io/sha256.h"
#include "tests/e2e/bad_input.h"

namespace panofix::e2e {
namespace {

namespace fs = std::filesystem;

const TownData& Data() { return SharedData().data; }

class BadBundle : public testing::Test {
 protected:
  BadBundle() { CopyFolder(SharedData().bundle, bundle_); }

  // Both halves refuse the bundle, with the same words.
  void ExpectBothRefuse(int exit_code, const std::vector<std::string>& words) const {
    ExpectRefused(Builder({"inspect", bundle_.string()}), exit_code, words);
    ExpectRefused(Data().Localize(bundle_, Data().drive(), Data().root() / "never.csv"), exit_code,
                  words);
    EXPECT_FALSE(fs::exists(Data().root() / "never.csv"));
  }
  [[nodiscard]] std::vector<std::string> Parts() const {
    std::vector<std::string> parts;
    const Json manifest = ReadJson(bundle_ / "manifest.json");
    for (const Json& part : manifest["parts"]) parts.push_back(part["path"]);
    return parts;
  }
  // Stamps the manifest as it now stands with its hash.
  void Rehash() const {
    WriteText(bundle_ / "manifest.json.sha256",
              Sha256Hex(ReadText(bundle_ / "manifest.json")) + "  manifest.json\n");
  }

  const fs::path bundle_ = Data().root() / "bad_bundle";
};

TEST_F(BadBundle, AFlippedByteInAnyPartIsFound) {
  std::vector<std::string> files = Parts();
  ASSERT_GE(files.size(), 3U);
  files.insert(files.end(), {"manifest.json", "manifest.json.sha256"});
  for (const std::string& file : files) {
    SCOPED_TRACE(file);
    CopyFolder(SharedData().bundle, bundle_);
    FlipMiddleByte(bundle_ / file);
    ExpectBothRefuse(kBadData, {file, "SHA-256", "fetch the bundle again or build it again"});
  }
}

TEST_F(BadBundle, ATruncatedOrMissingPartIsFound) {
  for (const std::string& file : Parts()) {
    SCOPED_TRACE(file);
    CopyFolder(SharedData().bundle, bundle_);
    TruncateFile(bundle_ / file, 0.5);
    ExpectBothRefuse(kBadData, {file, "bytes", "fetch the bundle again or build it again"});
    fs::remove(bundle_ / file);
    ExpectBothRefuse(kNotFound, {file, "fetch the bundle again or build it again"});
  }
  fs::remove(bundle_ / "manifest.json");
  ExpectBothRefuse(kNotFound, {"manifest.json"});
  fs::remove_all(bundle_);
  ExpectBothRefuse(kNotFound, {"bad_bundle", "build one"});
}

TEST_F(BadBundle, ANewerMajorVersionIsToldApart) {
  ReplaceInFile(bundle_ / "manifest.json", "\"major\": 2", "\"major\": 3");
  // Stamped or not: a newer format may hash another way.
  ExpectBothRefuse(kBadVersion, {"manifest.json", "bundle format 3", "update panofix"});
  Rehash();
  ExpectBothRefuse(kBadVersion, {"manifest.json", "bundle format 3", "update panofix"});
}

TEST_F(BadBundle, AnOlderMajorVersionMustBeBuiltAgain) {
  ReplaceInFile(bundle_ / "manifest.json", "\"major\": 2", "\"major\": 1");
  Rehash();
  ExpectBothRefuse(kBadVersion, {"manifest.json", "bundle format 1", "build the bundle again"});
}

TEST_F(BadBundle, ANewerMinorVersionIsRead) {
  ReplaceInFile(bundle_ / "manifest.json", "\"minor\": 2", "\"minor\": 7");
  Rehash();
  EXPECT_EQ(Builder({"inspect", bundle_.string()}).exit_code, 0);
}

TEST_F(BadBundle, AManifestThatLeavesItsFolderIsRefused) {
  ReplaceInFile(bundle_ / "manifest.json", "\"graph.h5\"", "\"../graph.h5\"");
  Rehash();
  ExpectBothRefuse(kBadData, {"manifest.json", "../graph.h5", "not allowed"});
}

class BadDrive : public testing::Test {
 protected:
  BadDrive() { CopyFolder(Data().drive(), drive_); }

  [[nodiscard]] Outcome Localize() const {
    return Data().Localize(SharedData().bundle, drive_, out_);
  }
  [[nodiscard]] std::vector<PoseRow> Poses() const {
    const Outcome outcome = Localize();
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    return ReadPosesCsv(out_).value();
  }

  const fs::path drive_ = Data().root() / "bad_drive", out_ = Data().root() / "bad_drive.csv";
};

TEST_F(BadDrive, AFrameThatCannotBeUsedStillHasItsRow) {
  const fs::path first = drive_ / "images" / "000000.jpg";
  const auto expect_reason = [&](const std::string& reason) {
    const std::vector<PoseRow> rows = Poses();
    ASSERT_EQ(rows.size(), kNumBadInputFrames);
    EXPECT_EQ(rows[0].status, FixStatus::kNoFix);
    EXPECT_EQ(rows[0].reason, reason);
    EXPECT_NE(rows[1].reason, reason);
  };
  TruncateFile(first, 0.5);
  expect_reason("frame_undecodable");
  WriteText(first, "no picture at all");
  expect_reason("frame_undecodable");
  fs::remove(first);
  expect_reason("frame_undecodable");
  fs::copy_file(Data().town() / "panoramas" / "pano-00000.jpg", first);
  expect_reason("frame_size_differs_from_camera");
}

TEST_F(BadDrive, TheCamerasOwnSizeDecides) {
  ReplaceInFile(drive_ / "camera.yaml", "image_width: 240", "image_width: 241");
  for (const PoseRow& row : Poses()) {
    EXPECT_EQ(row.status, FixStatus::kNoFix);
    EXPECT_EQ(row.reason, "frame_size_differs_from_camera");
  }
}

TEST_F(BadDrive, FilesThatBreakTheirRulesAreRefused) {
  const std::string frames = ReadText(drive_ / "frames.csv");
  ReplaceInFile(drive_ / "frames.csv", "timestamp_ns", "time");
  ExpectRefused(Localize(), kBadData, {"frames.csv", "timestamp_ns"});
  WriteText(drive_ / "frames.csv", "timestamp_ns,image\nnoon,images/000000.jpg\n");
  ExpectRefused(Localize(), kBadData, {"frames.csv:2", "noon"});
  WriteText(drive_ / "frames.csv", "timestamp_ns,image\n");
  ExpectRefused(Localize(), kBadData, {"frames.csv", "holds no frame", "write one row"});
  WriteText(drive_ / "frames.csv", frames);
  fs::remove(drive_ / "camera.yaml");
  ExpectRefused(Localize(), kNotFound, {"camera.yaml"});
  fs::remove(drive_ / "frames.csv");
  ExpectRefused(Localize(), kNotFound, {"frames.csv"});
  fs::remove_all(drive_);
  ExpectRefused(Localize(), kNotFound, {"bad_drive", "frames.csv and camera.yaml"});
}

TEST_F(BadDrive, AScoreWantsTheTruth) {
  fs::remove(drive_ / "truth.csv");
  ExpectRefused(Builder({"validate", SharedData().bundle.string(), "--drive", drive_.string()}),
                kNotFound, {"truth.csv", "a score needs the truth"});
}

}  // namespace
}  // namespace panofix::e2e
