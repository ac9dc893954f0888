#include "builder/publish/bundle_writer.h"

#include <algorithm>

#include "common/base/cancel.h"
#include "common/base/log.h"
#include "common/io/atomic_file.h"
#include "common/io/sha256.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

// "out/" names the folder "out": staging must lie beside it, not in it.
fs::path WithoutTrailingSlash(const fs::path& path) {
  return path.has_filename() ? path : path.parent_path();
}

// A folder that is removed unless it was published.
class Staging {
 public:
  explicit Staging(const fs::path& target)
      : path_(WithoutTrailingSlash(target).string() + ".staging-" + UniqueWord()) {
    std::error_code error;
    fs::remove_all(path_, error);
    if (!fs::create_directories(path_ / "tiles", error)) {
      throw Error(ErrorCode::kIo, path_.string() + ": cannot be made (" + error.message() +
                                      "); choose an --out folder you may write to");
    }
  }
  ~Staging() {
    std::error_code error;
    fs::remove_all(path_, error);
  }
  [[nodiscard]] const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

BundlePart Describe(const fs::path& root, const std::string& path) {
  ThrowIfError(SyncPath(root / path));
  return {path, static_cast<std::uint64_t>(fs::file_size(root / path)),
          ValueOrThrow(Sha256OfFile(root / path))};
}

// The manifest, last of all, and the rename.
void Finish(const fs::path& staged, const Manifest& manifest, const fs::path& target) {
  const std::string text = ToJson(manifest);
  ThrowIfError(WriteFileAtomically(staged / kManifestName, text));
  // The layout of sha256sum, so that `sha256sum -c` checks it too.
  ThrowIfError(WriteFileAtomically(staged / kManifestHashName,
                                   Sha256Hex(text) + "  " + kManifestName + "\n"));
  for (const char* folder : {"tiles", "images"}) {
    if (fs::exists(staged / folder)) ThrowIfError(SyncPath(staged / folder));
  }
  ThrowIfError(SyncPath(staged));
  ThrowIfError(PublishDirectory(staged, target));
}

// Copies a part that another run may have written; a file that is not what its hash says is named.
void CopyPart(const FinishedPart& finished, const fs::path& staged) {
  const fs::path to = staged / finished.part.path;
  fs::create_directories(to.parent_path());
  std::error_code error;
  fs::copy_file(finished.file, to, error);
  if (error) {
    const bool is_full = error == std::errc::no_space_on_device;
    throw Error(is_full ? ErrorCode::kNoSpace : ErrorCode::kIo,
                finished.file.string() + ": cannot be copied to " + to.string() + " (" +
                    error.message() + "); " + (is_full ? "free space" : "check both disks") +
                    " and run again");
  }
  const BundlePart copied = Describe(staged, finished.part.path);
  if (copied.sha256 != finished.part.sha256 || copied.num_bytes != finished.part.num_bytes) {
    throw Error(ErrorCode::kChecksumMismatch,
                finished.file.string() +
                    ": changed since it was written; delete it and run its stage again");
  }
}

}  // namespace

Manifest WriteBundle(const fs::path& target, BundleContent content, const MakeTile& make_tile) {
  const Staging staging(target);
  Manifest manifest = content.manifest;
  manifest.parts.clear();
  WriteVocabulary(staging.path() / "vocabulary.h5", content.vocabulary, content.pack_descriptors);
  manifest.parts.push_back(Describe(staging.path(), "vocabulary.h5"));
  // A vocabulary without a name of its own goes by its hash.
  if (manifest.vocabulary_release.empty())
    manifest.vocabulary_release = "sha256:" + manifest.parts.back().sha256;
  manifest.num_landmarks = 0;
  for (std::size_t begin = 0; begin < content.panoramas.size();) {
    if (CancelRequested())
      throw Error(ErrorCode::kCancelled, "stopped by the user; the next build resumes");
    std::size_t end = begin;
    const std::string& tile = content.tile_of_panorama[begin];
    while (end < content.panoramas.size() && content.tile_of_panorama[end] == tile) ++end;
    const std::string path = "tiles/" + tile + ".h5";
    const BundleTile made = make_tile(begin, end, &content.panoramas);
    WriteTile(staging.path() / path, content, begin, end, made);
    manifest.num_landmarks += static_cast<std::int64_t>(made.landmarks.size());
    manifest.parts.push_back(Describe(staging.path(), path));
    if (!made.view_images.empty()) {
      const std::string images = "images/" + tile + ".h5";
      WriteViewImages(staging.path() / images, content, begin, end, made);
      manifest.parts.push_back(Describe(staging.path(), images));
    }
    begin = end;
  }
  // Last: the tiles refine the panoramas' poses.
  WriteGraph(staging.path() / "graph.h5", content);
  manifest.parts.push_back(Describe(staging.path(), "graph.h5"));
  std::sort(manifest.parts.begin(), manifest.parts.end(),
            [](const BundlePart& a, const BundlePart& b) { return a.path < b.path; });
  manifest.num_panoramas = static_cast<std::int64_t>(content.panoramas.size());
  manifest.views_per_station = static_cast<int>(content.directions.size());
  manifest.num_stations = static_cast<std::int64_t>(content.stations.size());
  manifest.num_views = manifest.num_stations * manifest.views_per_station;
  Finish(staging.path(), manifest, target);
  return manifest;
}

Manifest PublishParts(const fs::path& target, const Manifest& manifest,
                      const std::vector<FinishedPart>& parts) {
  const Staging staging(target);
  for (const FinishedPart& finished : parts) {
    if (CancelRequested())
      throw Error(ErrorCode::kCancelled, "stopped by the user; the next build resumes");
    CopyPart(finished, staging.path());
  }
  Finish(staging.path(), manifest, target);
  return manifest;
}

}  // namespace panofix
