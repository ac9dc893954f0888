#pragma once
// A rendered town on disk, and the files of data sets, drives and bundles as tests bend them.

#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/common/io/temp_folder.h"
#include "tests/e2e/process.h"

namespace panofix::e2e {

using Json = nlohmann::ordered_json;

// A town that the present program rendered, gone with the object. Small pictures: seconds, not
// minutes.
class TownData {
 public:
  // `options` of panofix-town beside --out.
  explicit TownData(const std::vector<std::string>& options);

  // Where tests may put their own files.
  [[nodiscard]] const std::filesystem::path& root() const { return folder_.path(); }
  [[nodiscard]] std::filesystem::path town() const { return folder_ / "town"; }
  [[nodiscard]] std::filesystem::path drive() const { return town() / "drive"; }
  [[nodiscard]] std::filesystem::path panoramas() const { return town() / "panoramas.geojson"; }
  [[nodiscard]] std::filesystem::path camera() const { return town() / "camera.yaml"; }
  // panofix-builder build of `panoramas` into `out`; small vocabularies, stations 5 m apart, one
  // shared work folder.
  [[nodiscard]] Outcome Build(const std::filesystem::path& panoramas,
                              const std::filesystem::path& out,
                              const std::vector<std::string>& options = {}) const;
  [[nodiscard]] Outcome Localize(const std::filesystem::path& bundle,
                                 const std::filesystem::path& drive,
                                 const std::filesystem::path& out,
                                 const std::vector<std::string>& options = {}) const;

 private:
  TempFolder folder_;
};

// Options of a town where every frame can be localized: one light, a narrow spacing.
[[nodiscard]] std::vector<std::string> EasyTown();

[[nodiscard]] Json ReadJson(const std::filesystem::path& path);
// A data set beside the town's own, so that its paths hold: `name` in the same folder.
[[nodiscard]] std::filesystem::path WriteDataSet(const TownData& data, const std::string& name,
                                                 const Json& collection);
// A copy of a folder that a test may damage.
std::filesystem::path CopyFolder(const std::filesystem::path& from,
                                 const std::filesystem::path& to);
// Flips the lowest bit of the byte in the middle.
void FlipMiddleByte(const std::filesystem::path& path);
// Replaces the first `from` in a text file; fails the test where there is none.
void ReplaceInFile(const std::filesystem::path& path, const std::string& from,
                   const std::string& to);
// Cuts a file to `share` of its bytes.
void TruncateFile(const std::filesystem::path& path, double share);

}  // namespace panofix::e2e
