#include "builder/publish/staging.h"

#include "common/base/status.h"
#include "common/io/atomic_file.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

// "out/" names the folder "out": staging must lie beside it, not in it.
fs::path WithoutTrailingSlash(const fs::path& path) {
  return path.has_filename() ? path : path.parent_path();
}

}  // namespace

StagingFolder::StagingFolder(const fs::path& target)
    : path_(WithoutTrailingSlash(target).string() + ".staging-" + UniqueWord()) {
  std::error_code error;
  fs::remove_all(path_, error);
  if (!fs::create_directories(path_ / "tiles", error)) {
    throw Error(ErrorCode::kIo, path_.string() + ": cannot be made (" + error.message() +
                                    "); choose an --out folder you may write to");
  }
}

StagingFolder::~StagingFolder() {
  std::error_code error;
  fs::remove_all(path_, error);
}

}  // namespace panofix
