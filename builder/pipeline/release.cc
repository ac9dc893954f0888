#include "builder/pipeline/release.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "builder/pipeline/run_report.h"
#include "common/base/log.h"
#include "common/image/gray_image.h"
#include "common/io/sha256.h"
#include "common/map/map_bundle.h"
#include "common/map/vocabulary_file.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostBytes = std::size_t{1} << 32;
constexpr std::size_t kNameDigits = 12;

VocabularyRelease ReadFile(const fs::path& file) {
  VocabularyRelease release;
  const auto bytes = ValueOrThrow(ReadFileBytes(file, kMostBytes));
  release.bytes.assign(bytes.begin(), bytes.end());
  release.sha256 = Sha256Hex(release.bytes);
  const auto reader = Hdf5Reader::Open(file);
  auto vocabulary = reader.ok() ? ReadVocabulary(*reader) : reader.status();
  if (!vocabulary.ok()) {
    throw Error(ErrorCode::kBadData, file.string() + ": no vocabulary release (" +
                                         vocabulary.status().message() +
                                         "); name a vocabulary.h5 or a bundle");
  }
  release.vocabulary = std::move(vocabulary).value();
  return release;
}

int DepthOf(const VocabularyTree& tree) {
  std::vector<int> depth(tree.word.size(), 0);
  int deepest = 0;
  for (std::size_t node = 0; node < tree.word.size(); ++node) {
    for (std::uint32_t c = 0; c < tree.num_children[node]; ++c)
      depth[tree.first_child[node] + c] = depth[node] + 1;
    deepest = std::max(deepest, depth[node]);
  }
  return deepest;
}

}  // namespace

VocabularyRelease ReadRelease(const fs::path& path, bool root_sift) {
  if (!fs::is_directory(path)) return ReadFile(path);
  std::string ignored;
  const Manifest manifest = ValueOrThrow(MapBundle::ReadManifest(path, &ignored));
  VocabularyRelease release = ReadFile(path / "vocabulary.h5");
  const bool is_whole =
      std::any_of(manifest.parts.begin(), manifest.parts.end(), [&](const BundlePart& part) {
        return part.path == "vocabulary.h5" && part.sha256 == release.sha256;
      });
  if (!is_whole) {
    throw Error(ErrorCode::kChecksumMismatch,
                path.string() + ": its vocabulary is not the one of its manifest; fetch it again");
  }
  if (manifest.features.root_sift != root_sift) {
    throw Error(ErrorCode::kInvalidArgument,
                path.string() + ": its vocabulary was trained on " +
                    (root_sift ? "plain SIFT; give --plain-sift" : "RootSIFT; give --root-sift") +
                    ", or another release for --vocabulary");
  }
  return release;
}

std::string DescribeRelease(const fs::path& file, bool as_json) {
  const VocabularyRelease release = ReadFile(file);
  const Vocabulary& v = release.vocabulary;
  const Saturation s = SaturationOf(v.idf);
  const std::string name = release.sha256.substr(0, kNameDigits);
  if (as_json) {
    const nlohmann::ordered_json j = {
        {"name", name},
        {"sha256", release.sha256},
        {"num_bytes", release.bytes.size()},
        {"sift", {{"num_words", v.sift.num_words}, {"depth", DepthOf(v.sift)}}},
        {"mser", {{"num_words", v.mser.num_words}, {"depth", DepthOf(v.mser)}}},
        {"num_used", s.num_used},
        {"mean_share", s.mean_share},
        {"typical_share", s.typical_share}};
    return j.dump(1) + "\n";
  }
  std::string text = Format("%-14s %s\n", "vocabulary", name.c_str());
  text += Format("%-14s %u SIFT (depth %d), %u MSER (depth %d)\n", "words", v.sift.num_words,
                 DepthOf(v.sift), v.mser.num_words, DepthOf(v.mser));
  text += Format("%-14s %lld words when it was weighed\n", "in use",
                 static_cast<long long>(s.num_used));
  text += Format("%-14s a word was in %.3f %% of the views; one of a view, in %.3f %%\n",
                 "saturation", 100 * s.mean_share, 100 * s.typical_share);
  text += Format("%-14s %.1f kB\n", "size", static_cast<double>(release.bytes.size()) / 1e3);
  return text;
}

}  // namespace panofix
