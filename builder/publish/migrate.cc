#include "builder/publish/migrate.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "builder/publish/bundle_writer.h"
#include "common/base/log.h"
#include "common/io/read_file.h"
#include "common/map/bundle_files.h"

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

// What format 2.1 says and 2.0 did not; both as a build of today would.
void StepToTwoOne(Manifest* manifest) {
  const auto part = std::find_if(manifest->parts.begin(), manifest->parts.end(),
                                 [](const BundlePart& p) { return p.path == kVocabularyPart; });
  if (part == manifest->parts.end()) {
    throw Error(ErrorCode::kBadData, std::string("the bundle has no part ") + kVocabularyPart +
                                         "; fetch it again or build it again");
  }
  manifest->vocabulary_release = "sha256:" + part->sha256;
  manifest->runtime_min = kOldestRuntime;
  manifest->runtime_before.clear();
  manifest->minor = 1;
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
  static_assert(kBundleMajor == 2 && kBundleMinor == 1,
                "a step of the format brings its migration");
  if (manifest.minor < 1) StepToTwoOne(&manifest);
  manifest.build = build.value_or(manifest.build);
  std::vector<FinishedPart> parts;
  for (const BundlePart& part : manifest.parts) parts.push_back({part, from / part.path});
  return PublishParts(out, manifest, parts);
}

}  // namespace panofix
