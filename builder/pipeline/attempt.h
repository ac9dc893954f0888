#pragma once
// Remembers what a program was at, for the case that it does not live to tell.

#include <filesystem>
#include <string>

#include "builder/pipeline/work_folder.h"

namespace panofix {

// Attempts at one panorama that end the program, after which it is not tried again.
inline constexpr int kMostAttempts = 3;

// While it lives, a note in the work folder says that `id` is under way; a program that dies leaves
// the note. Attempts count as long as the content's key stays the same.
class Attempt {
 public:
  Attempt(const WorkFolder& work, Stage stage, const std::string& id, const std::string& key);
  ~Attempt();
  Attempt(const Attempt&) = delete;
  Attempt& operator=(const Attempt&) = delete;
  // Whether earlier ones ended the program too often. The note then stays.
  [[nodiscard]] bool IsHopeless() const { return num_before_ >= kMostAttempts; }
  // What to tell the user then: fault and mend.
  [[nodiscard]] std::string Reason() const;

  // Whether a program died at `id`: such are tried alone, so that the right one is blamed.
  [[nodiscard]] static bool IsSuspect(const WorkFolder& work, Stage stage, const std::string& id);

 private:
  std::filesystem::path note_;
  int num_before_ = 0;
};

}  // namespace panofix
