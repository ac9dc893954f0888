#include "builder/publish/migrate.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "builder/publish/bundle_writer.h"
#include "builder/publish/staging.h"
#include "common/base/cancel.h"
#include "common/base/log.h"
#include "common/io/hdf5_file.h"
#include "common/io/read_file.h"
#include "common/io/sha256.h"
#include "common/map/bundle_files.h"
#include "common/map/landmark_codes.h"
#include "common/map/landmark_words.h"
#include "common/map/vocabulary_file.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

constexpr char kVocabularyPart[] = "vocabulary.h5";

// Of a manifest that this release does not read.
int MajorOf(const fs::path& bundle) {
  const auto json =
      nlohmann::json::parse(ValueOrThrow(ReadFileText(bundle / kManifestName, kMaxManifestBytes)));
  return json.at("format").at("major").get<int>();
}

SignedManifest ReadOld(const fs::path& from) {
  auto old = ReadSignedManifest(from, {});
  if (old.ok()) return std::move(*old);
  if (old.status().code() != ErrorCode::kUnsupportedVersion || MajorOf(from) >= kBundleMajor)
    throw Error(old.status());
  throw Error(old.status().code(),
              old.status().message() +
                  " (what this format holds is made from the panoramas, and a bundle has none)");
}

const BundlePart& VocabularyOf(const Manifest& manifest) {
  const auto part = std::find_if(manifest.parts.begin(), manifest.parts.end(),
                                 [](const BundlePart& p) { return p.path == kVocabularyPart; });
  if (part == manifest.parts.end()) {
    throw Error(ErrorCode::kBadData, std::string("the bundle has no part ") + kVocabularyPart +
                                         "; fetch it again or build it again");
  }
  return *part;
}

// What format 2.1 says and 2.0 did not; both as a build of today would.
void StepToTwoOne(Manifest* manifest) {
  manifest->vocabulary_release = "sha256:" + VocabularyOf(*manifest).sha256;
  manifest->runtime_min = kOldestRuntime;
  manifest->runtime_before.clear();
}

Hdf5Reader OpenVerified(const fs::path& bundle, const BundlePart& part) {
  const std::string name = (bundle / part.path).string();
  const UniqueFd file = ValueOrThrow(OpenPart(bundle, part));
  const UniqueFd copy = ValueOrThrow(CopyVerifiedPart(file.get(), part, name));
  return ValueOrThrow(Hdf5Reader::Open(copy.get(), name));
}

template <typename T>
MappedArray<T> Copy(const Hdf5Reader& from, const std::string& name, Hdf5Writer* to) {
  auto array = ValueOrThrow(from.Read<T>(name, -1));
  to->Write<T>(name, array.values, array.cols);
  return array;
}

// All arrays of a tile as they were, in the builder's order, and the words of its landmarks.
void WriteWithWords(const Hdf5Reader& from, const VocabularyTree& sift, const fs::path& path) {
  Hdf5Writer to(path);
  Copy<std::uint8_t>(from, "panorama_ids", &to);
  Copy<std::uint8_t>(from, "anchors/panorama_ids", &to);
  Copy<std::uint32_t>(from, "anchors/landmark_offsets", &to);
  Copy<std::uint32_t>(from, "anchors/plane_offsets", &to);
  Copy<float>(from, "anchors/planes", &to);
  Copy<float>(from, "landmarks/points_in_pano", &to);
  Copy<std::uint8_t>(from, "landmarks/codes", &to);
  const auto descriptors = Copy<std::uint8_t>(from, "landmarks/descriptors", &to);
  if (descriptors.cols != kDescriptorSize && descriptors.cols != kPackedDescriptorSize) {
    throw Error(ErrorCode::kBadData,
                "landmarks/descriptors: rows of another length; fetch the "
                "bundle again or build it again");
  }
  to.Write<std::uint32_t>("landmarks/words",
                          WordsOfDescriptors(sift, descriptors.values, descriptors.cols));
  Copy<std::uint32_t>(from, "views/landmark_offsets", &to);
  Copy<std::uint32_t>(from, "views/landmarks", &to);
  Copy<std::uint32_t>(from, "bags/offsets", &to);
  Copy<std::uint32_t>(from, "bags/words", &to);
  Copy<std::uint8_t>(from, "bags/weights", &to);
  to.Close();
}

// Format 2.2 keeps in its tiles what 2.1 had readers derive. Tiles that are written anew lie in
// `folder`.
std::vector<FinishedPart> StepToTwoTwo(const fs::path& from, const fs::path& folder,
                                       Manifest* manifest) {
  const auto vocabulary = ValueOrThrow(ReadVocabulary(OpenVerified(from, VocabularyOf(*manifest))));
  std::vector<FinishedPart> parts;
  for (BundlePart& part : manifest->parts) {
    if (CancelRequested()) throw Error(ErrorCode::kCancelled, "stopped by the user");
    fs::path file = from / part.path;
    if (part.path.starts_with("tiles/")) {
      const Hdf5Reader old = OpenVerified(from, part);
      file = folder / part.path;
      fs::create_directories(file.parent_path());
      WriteWithWords(old, vocabulary.sift, file);
      part = {part.path, fs::file_size(file), ValueOrThrow(Sha256OfFile(file))};
    }
    parts.push_back({part, file});
  }
  return parts;
}

}  // namespace

Manifest MigrateBundle(const fs::path& from, const fs::path& out,
                       std::optional<std::int64_t> build) {
  Manifest manifest = ReadOld(from).manifest;
  const auto refuse = [&](ErrorCode code, const char* why) {
    throw Error(code, Format("%s: bundle format %d.%d, this program writes %d.%d; %s", from.c_str(),
                             manifest.major, manifest.minor, kBundleMajor, kBundleMinor, why));
  };
  if (manifest.minor > kBundleMinor)
    refuse(ErrorCode::kUnsupportedVersion, "nothing leads back; use it as it is");
  if (manifest.minor == kBundleMinor)
    refuse(ErrorCode::kInvalidArgument, "there is nothing to migrate; use it as it is");
  if (fs::exists(fs::symlink_status(out))) {
    throw Error(ErrorCode::kInvalidArgument,
                out.string() + ": is there already; name a new folder with --out");
  }
  if (build && *build < manifest.build) {
    throw Error(ErrorCode::kInvalidArgument,
                Format("--build %lld: the old bundle is build %lld, and numbers only grow",
                       static_cast<long long>(*build), static_cast<long long>(manifest.build)));
  }
  static_assert(kBundleMajor == 2 && kBundleMinor == 2,
                "a step of the format brings its migration");
  if (manifest.minor < 1) StepToTwoOne(&manifest);
  const StagingFolder rewritten(out);
  const std::vector<FinishedPart> parts = StepToTwoTwo(from, rewritten.path(), &manifest);
  manifest.minor = kBundleMinor;
  manifest.build = build.value_or(manifest.build);
  return PublishParts(out, manifest, parts);
}

}  // namespace panofix
