// Options and folders that cannot be right, through both programs.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "tests/e2e/bad_input.h"

namespace panofix::e2e {
namespace {

namespace fs = std::filesystem;

const TownData& Data() { return SharedData().data; }

TEST(BadUse, UnknownWordsAndValuesAreNamed) {
  const std::string builder_help = "see panofix-builder --help";
  const std::string runtime_help = "see panofix-runtime --help";
  const fs::path out = Data().root() / "unused";
  ExpectRefused(Data().Build(Data().panoramas(), out, {"--frobnicate"}), kWrongUse,
                {"--frobnicate", builder_help});
  ExpectRefused(Builder({"bild"}), kWrongUse, {builder_help});
  ExpectRefused(Builder({}), kWrongUse, {"subcommand", builder_help});
  ExpectRefused(Builder({"build", "--panoramas", "a.geojson"}), kWrongUse,
                {"--camera", builder_help});
  ExpectRefused(Data().Build(Data().panoramas(), out, {"--views", "many"}), kWrongUse,
                {"--views", builder_help});
  ExpectRefused(Data().Build(Data().panoramas(), out, {"--views", "0"}), kWrongUse,
                {"num_views = 0", "1..64"});
  ExpectRefused(Data().Build(Data().panoramas(), out, {"--preset", "papre"}), kWrongUse,
                {"papre", "default or paper"});
  ExpectRefused(Data().Build(Data().panoramas(), out, {"--equalization", "loud"}), kWrongUse,
                {"loud", "clahe"});
  ExpectRefused(Data().Localize(SharedData().bundle, Data().drive(), out, {"--start", "here"}),
                kWrongUse, {"--start", runtime_help});
  ExpectRefused(Data().Localize(SharedData().bundle, Data().drive(), out, {"--format", "kml"}),
                kWrongUse, {"kml", "csv, tum, geojson or gpx"});
  ExpectRefused(Data().Localize(SharedData().bundle, Data().drive(), out, {"--threads", "-1"}),
                kWrongUse, {"num_threads = -1"});
  ExpectRefused(Data().Localize(SharedData().bundle, Data().drive(), out,
                                {"--preset", "paper", "--add", "pooled,luck"}),
                kWrongUse, {"luck", "pooled"});
  ExpectRefused(Data().Localize(SharedData().bundle, Data().drive(), out,
                                {"--preset", "paper", "--add", "guided"}),
                kWrongUse, {"guided", "pooled"});
  ExpectRefused(Data().Localize(SharedData().bundle, Data().drive(), out, {"--preset", "paper"}),
                kWrongUse, {"--keep-view-images"});
  ExpectRefused(Runtime({"play", "--drive", Data().drive().string(), "--bind", "tcp://*:5601",
                         "--rate", "0"}),
                kWrongUse, {"rate_hz 0", "0.01..1000"});
  EXPECT_FALSE(fs::exists(out));
}

TEST(BadUse, HelpAndVersionAreNoFaults) {
  for (const Outcome& outcome : {Builder({"--help"}), Builder({"build", "--help"}),
                                 Runtime({"--help"}), Runtime({"serve", "--help"})}) {
    EXPECT_EQ(outcome.exit_code, 0);
    EXPECT_THAT(outcome.output, testing::HasSubstr("--help"));
    EXPECT_EQ(outcome.errors, "");
  }
  EXPECT_THAT(Builder({"--version"}).output, testing::HasSubstr("panofix-builder "));
  EXPECT_THAT(Runtime({"--version"}).output, testing::HasSubstr("panofix-runtime "));
}

TEST(BadUse, FoldersThatCannotBeWrittenAreNamed) {
  const fs::path file = Data().root() / "a_file";
  WriteText(file, "not a folder");
  ExpectRefused(Data().Build(Data().panoramas(), file / "map"), kDisk,
                {(file / "map").string(), "--out"});
  ExpectRefused(Data().Build(Data().panoramas(), Data().root() / "unused",
                             {"--work", (file / "work").string()}),
                kDisk, {(file / "work").string(), "--work"});
  EXPECT_FALSE(fs::exists(Data().root() / "unused"));
  if (::geteuid() == 0) GTEST_SKIP() << "the superuser may write anywhere; the rest needs a user";
  const fs::path locked = Data().root() / "locked";
  fs::create_directory(locked);
  fs::permissions(locked, fs::perms::owner_read | fs::perms::owner_exec);
  ExpectRefused(Data().Build(Data().panoramas(), locked / "map"), kDisk,
                {(locked / "map").string(), "--out"});
  ExpectRefused(Data().Localize(SharedData().bundle, Data().drive(), locked / "poses.csv"), kDisk,
                {(locked / "poses.csv").string()});
}

TEST(BadUse, AFolderThatIsNoBundleIsKept) {
  const fs::path foreign = Data().root() / "foreign";
  fs::create_directory(foreign);
  WriteText(foreign / "thesis.txt", "years of work");
  ExpectRefused(Data().Build(Data().panoramas(), foreign), kWrongUse, {"foreign", "--out"});
  EXPECT_EQ(ReadText(foreign / "thesis.txt"), "years of work");
  ExpectRefused(Data().Localize(SharedData().bundle, Data().drive(), foreign), kWrongUse,
                {"foreign", "folder"});
}

TEST(BadUse, ADepthFileThatIsNoneIsNamed) {
  const fs::path good = Data().town() / "panoramas" / "pano-00000.gsv";
  const fs::path cut = Data().root() / "cut.gsv";
  fs::copy_file(good, cut);
  TruncateFile(cut, 0.5);
  ExpectRefused(Builder({"depth", cut.string()}), kBadData, {"cut.gsv", "again"});
  WriteText(cut, "{\"planes\": []}");
  ExpectRefused(Builder({"depth", cut.string()}), kBadData, {"cut.gsv", "not base64"});
  ExpectRefused(Builder({"depth", "nowhere.gsv"}), kNotFound, {"nowhere.gsv", "check the path"});
  ExpectRefused(Builder({"depth", good.string(), "--pixel", "512,0"}), kWrongUse,
                {"512,0", "columns are 0..511"});
}

}  // namespace
}  // namespace panofix::e2e
