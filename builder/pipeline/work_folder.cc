#include "builder/pipeline/work_folder.h"

#include <chrono>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <vector>

#include "common/io/atomic_file.h"

namespace panofix {

namespace fs = std::filesystem;

const char* StageName(Stage stage) {
  switch (stage) {
    case Stage::kExtract:
      return "extract";
    case Stage::kAugment:
      return "augment";
    case Stage::kSample:
      return "sample";
    case Stage::kTrain:
      return "train";
    case Stage::kWords:
      return "words";
    case Stage::kWeigh:
      return "weigh";
    case Stage::kLandmarks:
      return "landmarks";
    case Stage::kSimilarity:
      return "similarity";
    case Stage::kAssemble:
      return "assemble";
  }
  throw std::logic_error("no such stage");
}

StageUnit UnitOf(Stage stage) {
  switch (stage) {
    case Stage::kExtract:
    case Stage::kAugment:
    case Stage::kSample:
    case Stage::kWords:
      return StageUnit::kShard;
    case Stage::kLandmarks:
    case Stage::kSimilarity:
      return StageUnit::kTile;
    case Stage::kTrain:
    case Stage::kWeigh:
    case Stage::kAssemble:
      return StageUnit::kAll;
  }
  throw std::logic_error("no such stage");
}

std::string StageCommand(Stage stage, const std::string& unit) {
  const std::string name = StageName(stage);
  switch (UnitOf(stage)) {
    case StageUnit::kShard:
      return name + " --shard " + unit;
    case StageUnit::kTile:
      return name + " --tile " + unit;
    case StageUnit::kAll:
      return name;
  }
  throw std::logic_error("no such unit");
}

fs::path WorkFolder::Content(const std::string& kind, const std::string& key,
                             const std::string& extension) const {
  const fs::path folder = root_ / kind;
  ThrowIfError(MakeDirectories(folder, "--work"));
  return folder / (key + extension);
}

std::string StartRun(const WorkFolder& work) {
  const std::string run = UniqueWord();
  ThrowIfError(WriteFileAtomically(work.root() / "run", run + "\n"));
  return run;
}

std::string ReadRun(const WorkFolder& work) {
  std::ifstream file(work.root() / "run");
  std::string run;
  std::getline(file, run);
  return run;
}

void RemoveStale(const WorkFolder& work, const fs::path& out) {
  const auto long_ago = fs::file_time_type::clock::now() - std::chrono::hours(24);
  std::vector<fs::path> stale;
  std::error_code ignored;
  const auto look_at = [&](const fs::path& path) {
    const auto time = fs::last_write_time(path, ignored);
    if (!ignored && time < long_ago) stale.push_back(path);
  };
  for (const auto& entry : fs::recursive_directory_iterator(
           work.root(), fs::directory_options::skip_permission_denied, ignored)) {
    if (entry.path().extension() == ".tmp") look_at(entry.path());
  }
  const std::string staging = out.filename().string() + ".staging-";
  const fs::path folder = fs::absolute(out).parent_path();
  for (const auto& entry : fs::directory_iterator(folder, ignored)) {
    if (entry.path().filename().string().starts_with(staging)) look_at(entry.path());
  }
  for (const fs::path& path : stale) fs::remove_all(path, ignored);
}

bool WriteIfChanged(const fs::path& path, const std::string& text) {
  {
    std::ifstream file(path, std::ios::binary);
    std::ostringstream there;
    if (file && there << file.rdbuf() && there.str() == text) return false;
  }
  ThrowIfError(MakeDirectories(path.parent_path(), "--work"));
  ThrowIfError(WriteFileAtomically(path, text));
  return true;
}

}  // namespace panofix
