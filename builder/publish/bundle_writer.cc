#include "builder/publish/bundle_writer.h"

#include "builder/publish/staging.h"
#include "common/base/cancel.h"
#include "common/base/log.h"
#include "common/io/atomic_file.h"
#include "common/io/sha256.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

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
  const bool was_signed = fs::exists(target / kManifestSignatureName);
  ThrowIfError(PublishDirectory(staged, target));
  if (was_signed) {
    LogWarning(target.string() +
               ": the bundle in its place was signed, this one is not; sign it with "
               "panofix-builder sign");
  }
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

Manifest PublishParts(const fs::path& target, const Manifest& manifest,
                      const std::vector<FinishedPart>& parts) {
  const StagingFolder staging(target);
  for (const FinishedPart& finished : parts) {
    if (CancelRequested())
      throw Error(ErrorCode::kCancelled, "stopped by the user; the next build resumes");
    CopyPart(finished, staging.path());
  }
  Finish(staging.path(), manifest, target);
  return manifest;
}

}  // namespace panofix
