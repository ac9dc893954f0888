#include "builder/pipeline/work_folder.h"

#include <fstream>
#include <sstream>
#include <stdexcept>

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
