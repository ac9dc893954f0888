#pragma once
// A folder beside a target that is removed again unless it took the target's place.

#include <filesystem>

namespace panofix {

class StagingFolder {
 public:
  // Makes `TARGET.staging-WORD` with an empty `tiles` in it. Throws Error(kIo).
  explicit StagingFolder(const std::filesystem::path& target);
  ~StagingFolder();
  StagingFolder(const StagingFolder&) = delete;
  StagingFolder& operator=(const StagingFolder&) = delete;
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace panofix
