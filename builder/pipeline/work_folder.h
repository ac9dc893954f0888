#pragma once
// Where a build keeps its intermediate files (schemas/work_files.md).

#include <filesystem>
#include <string>

namespace panofix {

// The stages after the plan, in the order of their needs.
enum class Stage {
  kExtract,     // a shard: features of the panoramas' own views
  kAugment,     // a shard: features of the views rendered between them
  kSample,      // a shard: descriptors to train on
  kTrain,       // all: the vocabulary's trees
  kWords,       // a shard: visual words of all views
  kWeigh,       // all: the words' weights; the vocabulary is then whole
  kLandmarks,   // a tile: its part of the bundle
  kSimilarity,  // a tile: its rows of D_DB x r
  kAssemble,    // all: graph and manifest
};
inline constexpr Stage kAllStages[] = {Stage::kExtract,   Stage::kAugment,    Stage::kSample,
                                       Stage::kTrain,     Stage::kWords,      Stage::kWeigh,
                                       Stage::kLandmarks, Stage::kSimilarity, Stage::kAssemble};
enum class StageUnit { kShard, kTile, kAll };

[[nodiscard]] const char* StageName(Stage stage);  // the command's name, e.g. "extract"
[[nodiscard]] StageUnit UnitOf(Stage stage);
inline constexpr char kAllUnit[] = "all";  // the one unit of a stage over everything
// "extract --shard 0231", as a user would type it.
[[nodiscard]] std::string StageCommand(Stage stage, const std::string& unit);

class WorkFolder {
 public:
  explicit WorkFolder(std::filesystem::path root) : root_(std::move(root)) {}
  [[nodiscard]] const std::filesystem::path& root() const { return root_; }
  [[nodiscard]] std::filesystem::path plan() const { return root_ / "plan.json"; }
  [[nodiscard]] std::filesystem::path camera() const { return root_ / "plan" / "camera.yaml"; }
  [[nodiscard]] std::filesystem::path release() const { return root_ / "plan" / "vocabulary.h5"; }
  [[nodiscard]] std::filesystem::path records(const std::string& shard) const {
    return root_ / "plan" / "shards" / (shard + ".geojsonl");
  }
  // Changes whenever a record does, or the time or size of a file that one names.
  [[nodiscard]] std::filesystem::path stamp(const std::string& shard) const {
    return root_ / "plan" / "shards" / (shard + ".stamp");
  }
  [[nodiscard]] std::filesystem::path plan_report() const {
    return root_ / "reports" / "plan" / "all.json";
  }
  // What a stage's unit has made, and how the last run of it went.
  [[nodiscard]] std::filesystem::path receipt(Stage stage, const std::string& unit) const {
    return root_ / "receipts" / StageName(stage) / (unit + ".json");
  }
  [[nodiscard]] std::filesystem::path report(Stage stage, const std::string& unit) const {
    return root_ / "reports" / StageName(stage) / (unit + ".json");
  }
  // A file named by the hash of what decides its content. Its folder is made.
  [[nodiscard]] std::filesystem::path Content(const std::string& kind, const std::string& key,
                                              const std::string& extension = ".h5") const;

 private:
  std::filesystem::path root_;
};

// A run begins with its plan; reports of units say which run they are of. Throws Error.
std::string StartRun(const WorkFolder& work);               // returns the new run's name
[[nodiscard]] std::string ReadRun(const WorkFolder& work);  // empty where there was none

// Removes what killed programs left a day ago or earlier: temporary files in the work folder, and
// bundles being written beside `out`.
void RemoveStale(const WorkFolder& work, const std::filesystem::path& out);

// Writes `text` unless that is what the file holds; whether it did. Its folder is made. Throws
// Error. What is not changed keeps its time, so that engines that look at times stay calm.
bool WriteIfChanged(const std::filesystem::path& path, const std::string& text);

}  // namespace panofix
