// Shards, stages as programs, kills, full disks and later nights: the same bytes, or none.
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <chrono>
#include <optional>
#include <thread>

#include "common/base/rng.h"
#include "tests/e2e/staged_build.h"

namespace panofix::e2e {
namespace {

namespace fs = std::filesystem;

// Twelve panoramas over two tiles and some ten shards of level 21.
class StagedBuild : public testing::Test {
 protected:
  static constexpr const char* kShardLevel = "21";

  static void SetUpTestSuite() {
    data_ = std::make_unique<TownData>(std::vector<std::string>{
        "--seed", "5", "--panoramas", "12", "--no-drive", "--pano-width-px", "640",
        "--frame-width-px", "200", "--frame-height-px", "150"});
    panoramas_ = AcrossATileBorder();
    const Outcome outcome =
        Builder(Arguments("build", panoramas_, "reference", {"--threads", "1"}));
    ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
    reference_ = ReadTree(Out("reference"));
    ASSERT_GE(NumTiles(reference_), 2U);
  }
  static void TearDownTestSuite() { data_.reset(); }
  void SetUp() override { ASSERT_GE(reference_.size(), 6U); }

  // The town moved so that a tile's border runs through it.
  static fs::path AcrossATileBorder() {
    Json set = ReadJson(data_->panoramas());
    double west_deg = 180, east_deg = -180;
    for (const Json& feature : set["features"]) {
      const double lon_deg = feature["geometry"]["coordinates"][0];
      west_deg = std::min(west_deg, lon_deg), east_deg = std::max(east_deg, lon_deg);
    }
    constexpr double kTile_deg = 360.0 / (1 << 17);
    const double middle_deg = 0.5 * (west_deg + east_deg);
    const double shift_deg = std::round(middle_deg / kTile_deg) * kTile_deg - middle_deg;
    for (Json& feature : set["features"]) {
      Json& lon_deg = feature["geometry"]["coordinates"][0];
      lon_deg = lon_deg.get<double>() + shift_deg;
    }
    return WriteDataSet(*data_, "border.geojson", set);
  }
  static std::size_t NumTiles(const Files& files) {
    return static_cast<std::size_t>(std::count_if(
        files.begin(), files.end(), [](const auto& f) { return f.first.starts_with("tiles/"); }));
  }
  static fs::path Out(const std::string& name) { return data_->root() / name; }
  static fs::path Work(const std::string& name) { return data_->root() / (name + ".work"); }
  static std::vector<std::string> Arguments(const std::string& command, const fs::path& panoramas,
                                            const std::string& name,
                                            const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments{command,
                                       "--panoramas",
                                       panoramas.string(),
                                       "--camera",
                                       data_->camera().string(),
                                       "--out",
                                       Out(name).string(),
                                       "--name",
                                       "town",
                                       "--sift-words",
                                       "300",
                                       "--mser-words",
                                       "100",
                                       "--station-spacing-m",
                                       "6"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }
  static StageCall WithWork(StageCall call, const std::string& name) {
    call.insert(call.end(), {"--work", Work(name).string()});
    return call;
  }
  // The rest of a build whose plan is there.
  static void RunStages(const std::string& name, std::uint64_t shuffle_seed) {
    for (const StageCall& call : StageCalls(Work(name), shuffle_seed)) {
      const Outcome outcome = Builder(WithWork(call, name));
      ASSERT_EQ(outcome.exit_code, 0) << call[0] << ": " << outcome.errors;
    }
  }
  static void ExpectReference(const std::string& name) {
    ExpectSameFiles(ReadTree(Out(name)), reference_);
  }
  static void ExpectBuilds(const std::vector<std::string>& arguments) {
    const Outcome outcome = Builder(arguments);
    ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  }

  static inline std::unique_ptr<TownData> data_;
  static inline fs::path panoramas_;
  static inline Files reference_;
};

TEST_F(StagedBuild, ManyShardsInOneProcess) {
  ExpectBuilds(Arguments("build", panoramas_, "sharded", {"--shard-level", kShardLevel}));
  EXPECT_GE(ReadJson(Work("sharded") / "plan.json")["shards"].size(), 8U);
  ExpectReference("sharded");
}

TEST_F(StagedBuild, StagesAsProgramsInAnyOrder) {
  ExpectBuilds(Arguments("plan", panoramas_, "staged", {"--shard-level", kShardLevel}));
  RunStages("staged", 1);
  ExpectReference("staged");
  // Again, in another order: everything is there, and nothing changes.
  const Files before = ReadTree(Work("staged") / "receipts");
  RunStages("staged", 2);
  ExpectSameFiles(ReadTree(Work("staged") / "receipts"), before);
  for (const char* stage : {"extract", "augment", "words", "landmarks", "similarity", "train"}) {
    for (const auto& entry : fs::directory_iterator(Work("staged") / "reports" / stage)) {
      const Json report = ReadJson(entry.path());
      EXPECT_EQ(report["num_new"].get<int>() + report["num_redone"].get<int>(), 0) << entry.path();
    }
  }
  ExpectReference("staged");
}

TEST_F(StagedBuild, TheSameStageTwiceAtOnce) {
  ExpectBuilds(Arguments("plan", panoramas_, "twice", {"--shard-level", kShardLevel}));
  for (const StageCall& call : StageCalls(Work("twice"), 1)) {
    if (call[0] == "publish") continue;
    Process first(BuilderCommand(WithWork(call, "twice")));
    Process second(BuilderCommand(WithWork(call, "twice")));
    EXPECT_EQ(first.Wait(60.0), 0) << call[0] << ": " << first.Errors();
    EXPECT_EQ(second.Wait(60.0), 0) << call[0] << ": " << second.Errors();
  }
  ExpectBuilds(WithWork({"publish"}, "twice"));
  ExpectReference("twice");
}

// A stage out of turn says what to run, with the code that tells an engine to come again.
TEST_F(StagedBuild, AStageBeforeItsInputsIsToldToWait) {
  ExpectBuilds(Arguments("plan", panoramas_, "early", {"--shard-level", kShardLevel}));
  for (const StageCall& call : StageCalls(Work("early"), 1)) {
    if (call[0] == "extract") continue;
    const Outcome outcome = Builder(WithWork(call, "early"));
    EXPECT_EQ(outcome.exit_code, 75) << call[0] << ": " << outcome.errors;
    EXPECT_NE(outcome.errors.find("run: panofix-builder "), std::string::npos) << outcome.errors;
  }
  EXPECT_FALSE(fs::exists(Out("early")));
  const Outcome unknown = Builder(WithWork({"extract", "--shard", "3"}, "early"));
  EXPECT_EQ(unknown.exit_code, 64) << unknown.errors;
  EXPECT_EQ(Builder({"assemble", "--work", (data_->root() / "nowhere").string()}).exit_code, 66);
}

// Yesterday's receipts do not pass for today's.
TEST_F(StagedBuild, WhatIsOutOfDateIsNotPublished) {
  CopyFolder(Work("reference"), Work("stale"));
  Json set = ReadJson(panoramas_);
  set["features"].erase(3);
  ExpectBuilds(Arguments("plan", WriteDataSet(*data_, "fewer.geojson", set), "stale"));
  for (const char* stage : {"assemble", "publish"}) {
    const Outcome outcome = Builder(WithWork({stage}, "stale"));
    EXPECT_EQ(outcome.exit_code, 75) << outcome.errors;
  }
  EXPECT_FALSE(fs::exists(Out("stale")));
}

// Fifty times: any stage, any moment. The next run finishes, with the right bytes.
TEST_F(StagedBuild, KilledStagesLeaveNothingThatHarms) {
  constexpr int kKills = 50;
  constexpr double kLongest_s = 0.5;
  ExpectBuilds(Arguments("plan", panoramas_, "killed", {"--shard-level", kShardLevel}));
  Rng rng(1, "tests/kill");
  int num_killed = 0;
  for (std::uint64_t round = 0; num_killed < kKills; ++round) {
    for (const StageCall& call : StageCalls(Work("killed"), round)) {
      Process stage(BuilderCommand(WithWork(call, "killed")));
      std::this_thread::sleep_for(std::chrono::duration<double>(rng.Uniform(0, kLongest_s)));
      if (num_killed < kKills && stage.Running()) stage.Signal(SIGKILL);
      const std::optional<int> code = stage.Wait(60.0);
      if (code == 0) continue;  // it was through, perhaps as the signal came
      EXPECT_EQ(code, 128 + SIGKILL) << call[0] << ": " << stage.Errors();
      ++num_killed;
      if (fs::exists(Out("killed"))) ExpectReference("killed");
      ExpectBuilds(WithWork(call, "killed"));
    }
    ExpectReference("killed");
    for (const char* kind : {"words", "tiles", "stations", "receipts"}) {
      if (round % 2 == 0) fs::remove_all(Work("killed") / kind);  // work for the next round
    }
  }
}

// A file system that is too small: said in one line, nothing half-published, and room mends it.
TEST_F(StagedBuild, AFullDiskIsSaidAndMended) {
  const fs::path small = data_->root() / "small";
  fs::create_directories(small);
  const std::string mount = "mount -t tmpfs -o size=6m tmpfs " + small.string() + " 2>/dev/null";
  if (std::system(mount.c_str()) != 0) GTEST_SKIP() << "a file system cannot be mounted here";
  std::vector<std::string> arguments =
      Arguments("build", panoramas_, "small/map", {"--work", (small / "work").string()});
  const Outcome full = Builder(arguments);
  EXPECT_EQ(full.exit_code, 74) << full.errors;
  EXPECT_NE(full.errors.find("free space"), std::string::npos) << full.errors;
  EXPECT_FALSE(fs::exists(small / "map"));
  const std::string grow = "mount -o remount,size=200m " + small.string();
  EXPECT_EQ(std::system(grow.c_str()), 0);
  ExpectBuilds(arguments);
  ExpectSameFiles(ReadTree(small / "map"), reference_);
  EXPECT_EQ(std::system(("umount " + small.string()).c_str()), 0);
}

}  // namespace
}  // namespace panofix::e2e
