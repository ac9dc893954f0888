// Same inputs, same bytes: threads, input order, form of the input and interruptions change
// nothing.
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <chrono>
#include <thread>

#include "tests/e2e/staged_build.h"

namespace panofix::e2e {
namespace {

namespace fs = std::filesystem;

std::size_t NumFiles(const fs::path& folder) {
  std::error_code error;
  const fs::directory_iterator entries(folder, error);
  return error ? 0 : static_cast<std::size_t>(std::distance(begin(entries), end(entries)));
}

class ReproducibleBuild : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    data_ = std::make_unique<TownData>(
        std::vector<std::string>{"--seed", "5", "--panoramas", "5", "--no-drive", "--pano-width-px",
                                 "1024", "--frame-width-px", "320", "--frame-height-px", "240"});
    reference_ = BuildAs("reference", data_->panoramas(), {"--threads", "1"});
  }
  static void TearDownTestSuite() { data_.reset(); }
  void SetUp() override { ASSERT_GE(reference_.size(), 5U); }

  static fs::path Work(const std::string& name) { return data_->root() / (name + ".work"); }
  // The bundle's files, built in a work folder of its own.
  static Files BuildAs(const std::string& name, const fs::path& panoramas,
                       std::vector<std::string> options) {
    options.insert(options.end(), {"--name", "town", "--work", Work(name).string()});
    const fs::path out = data_->root() / name;
    const Outcome outcome = data_->Build(panoramas, out, options);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    return outcome.exit_code == 0 ? ReadTree(out) : Files{};
  }
  static void ExpectReference(const Files& files) { ExpectSameFiles(files, reference_); }
  // Starts a build and interrupts it once a panorama is done; false where it was done before.
  static bool Interrupt(const std::string& name) {
    Process build(
        BuilderCommand({"build", "--panoramas", data_->panoramas().string(), "--camera",
                        data_->camera().string(), "--out", (data_->root() / name).string(),
                        "--name", "town", "--work", Work(name).string(), "--sift-words", "500",
                        "--mser-words", "200", "--station-spacing-m", "5", "--threads", "1"}));
    while (NumFiles(Work(name) / "features") == 0 && build.Running()) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    build.Signal(SIGINT);
    constexpr double kPatience_s = 60;
    const auto exit_code = build.Wait(kPatience_s);
    if (exit_code == 0) return false;
    EXPECT_EQ(exit_code, 130) << build.Errors();
    return true;
  }

  static inline std::unique_ptr<TownData> data_;
  static inline Files reference_;
};

TEST_F(ReproducibleBuild, ThreadsChangeNothing) {
  ExpectReference(BuildAs("two", data_->panoramas(), {"--threads", "2"}));
}

TEST_F(ReproducibleBuild, OrderAndFormOfTheInputChangeNothing) {
  Json set = ReadJson(data_->panoramas());
  Json& features = set["features"];
  std::rotate(features.begin(), features.begin() + 2, features.end());
  std::swap(features[0], features[1]);
  ExpectReference(BuildAs("shuffled", WriteDataSet(*data_, "shuffled.geojson", set), {}));
  Json header = set;
  header.erase("features");
  std::string lines = header.dump() + "\n";
  for (const Json& feature : features) lines += feature.dump() + "\n";
  WriteText(data_->town() / "panoramas.geojsonl", lines);
  ExpectReference(BuildAs("lines", data_->town() / "panoramas.geojsonl", {}));
}

TEST_F(ReproducibleBuild, AnInterruptedBuildResumes) {
  bool interrupted = false;
  std::string name;
  // A machine that stalls may let the build end before the signal comes.
  for (int attempt = 0; attempt < 5 && !interrupted; ++attempt) {
    name = "interrupted" + std::to_string(attempt);
    interrupted = Interrupt(name);
  }
  ASSERT_TRUE(interrupted);
  EXPECT_FALSE(fs::exists(data_->root() / name)) << "an interrupted build published something";
  const std::size_t num_done = NumFiles(Work(name) / "features");
  EXPECT_GE(num_done, 1U);
  EXPECT_LT(num_done, 5U);
  ExpectReference(BuildAs(name, data_->panoramas(), {}));
  const Json report = ReadJson(data_->root() / (name + ".report.json"));
  EXPECT_EQ(report["stages"][1]["name"], "extract");
  EXPECT_EQ(report["stages"][1]["num_reused"], num_done);
}

TEST_F(ReproducibleBuild, ABuildOverAnEarlierOneReusesItsWork) {
  ExpectReference(BuildAs("reference", data_->panoramas(), {"--threads", "2"}));
  const Json report = ReadJson(data_->root() / "reference.report.json");
  EXPECT_EQ(report["stages"][1]["num_reused"], 5);
  EXPECT_EQ(report["stages"][2]["name"], "augment");
  EXPECT_EQ(report["stages"][2]["num_reused"], NumFiles(Work("reference") / "stations"));
  EXPECT_GE(NumFiles(Work("reference") / "stations"), 3U);
}

// A work file is worth no more than its bytes: a damaged one is made again.
TEST_F(ReproducibleBuild, ADamagedWorkFileIsMadeAgain) {
  CopyFolder(Work("reference"), Work("damaged"));
  for (const char* folder : {"features", "stations"})
    TruncateFile(fs::directory_iterator(Work("damaged") / folder)->path(), 0.5);
  ExpectReference(BuildAs("damaged", data_->panoramas(), {}));
}

TEST_F(ReproducibleBuild, ATrailingSlashNamesTheSameFolder) {
  CopyFolder(Work("reference"), Work("slash"));
  const Outcome outcome = data_->Build(data_->panoramas(), (data_->root() / "slash").string() + "/",
                                       {"--name", "town", "--work", Work("slash").string()});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  ExpectReference(ReadTree(data_->root() / "slash"));
}

// The control: what does differ shows, and only where it belongs. Without joint refinement and
// rendered views poses are in the graph alone.
TEST_F(ReproducibleBuild, AMovedPanoramaChangesTheGraphAlone) {
  const Files paper = BuildAs("paper", data_->panoramas(), {"--preset", "paper"});
  Json set = ReadJson(data_->panoramas());
  Json& longitude_deg = set["features"][2]["geometry"]["coordinates"][0];
  longitude_deg = longitude_deg.get<double>() + 1e-7;
  CopyFolder(Work("paper"), Work("moved"));
  const Files moved =
      BuildAs("moved", WriteDataSet(*data_, "moved.geojson", set), {"--preset", "paper"});
  ASSERT_EQ(moved.size(), paper.size());
  for (const auto& [path, bytes] : paper) {
    const bool names_poses = path == "graph.h5" || path.starts_with("manifest.json");
    EXPECT_EQ(moved.at(path) != bytes, names_poses) << path;
  }
  const auto hash_of = [](const Files& files) {
    return Json::parse(files.at("manifest.json"))["provenance"]["data_set_sha256"]
        .get<std::string>();
  };
  EXPECT_NE(hash_of(moved), hash_of(paper));
}

TEST_F(ReproducibleBuild, AnotherSeedTrainsAnotherVocabulary) {
  CopyFolder(Work("reference"), Work("seed"));
  const Files other = BuildAs("seed", data_->panoramas(), {"--seed", "2"});
  EXPECT_TRUE(other.at("vocabulary.h5") != reference_.at("vocabulary.h5"));
}

}  // namespace
}  // namespace panofix::e2e
