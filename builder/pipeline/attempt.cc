#include "builder/pipeline/attempt.h"

#include <fstream>

#include "common/base/log.h"
#include "common/io/atomic_file.h"
#include "common/io/sha256.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

fs::path NoteOf(const WorkFolder& work, Stage stage, const std::string& id) {
  return work.root() / "under_way" / (std::string(StageName(stage)) + "-" + Sha256Hex(id));
}

}  // namespace

Attempt::Attempt(const WorkFolder& work, Stage stage, const std::string& id, const std::string& key)
    : note_(NoteOf(work, stage, id)) {
  std::string noted_key;
  int num_noted = 0;
  if (std::ifstream note(note_); note >> noted_key >> num_noted && noted_key == key)
    num_before_ = num_noted;
  if (IsHopeless()) return;
  ThrowIfError(MakeDirectories(note_.parent_path(), "--work"));
  // Renamed into place, but not flushed: it is to survive the program, not the machine.
  const fs::path aside = note_.string() + "." + UniqueWord() + ".tmp";
  std::ofstream(aside) << key << " " << num_before_ + 1 << " " << id << "\n";
  std::error_code ignored;
  fs::rename(aside, note_, ignored);
}

Attempt::~Attempt() {
  if (IsHopeless()) return;
  std::error_code ignored;
  fs::remove(note_, ignored);
}

std::string Attempt::Reason() const {
  return Format(
      "%d attempts at it ended the program (a crash, or too little memory); mend its files, or "
      "delete %s to try again",
      kMostAttempts, note_.c_str());
}

bool Attempt::IsSuspect(const WorkFolder& work, Stage stage, const std::string& id) {
  std::error_code ignored;
  return fs::exists(NoteOf(work, stage, id), ignored);
}

}  // namespace panofix
