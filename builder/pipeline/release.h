#pragma once
// Vocabulary releases: the vocabulary.h5 of a bundle, reused by later builds.

#include <filesystem>
#include <string>

#include "common/vocabulary/vocabulary.h"

namespace panofix {

struct VocabularyRelease {
  std::string sha256;  // of the file; its first twelve digits are the release's name
  std::string bytes;
  Vocabulary vocabulary;
};

// `path`: a vocabulary.h5, or a bundle, whose manifest must then vouch for it and name the kind of
// descriptors that `root_sift` asks for. Throws Error.
[[nodiscard]] VocabularyRelease ReadRelease(const std::filesystem::path& path, bool root_sift);

// What a release is and how full it is, for people or as JSON. Throws Error.
[[nodiscard]] std::string DescribeRelease(const std::filesystem::path& file, bool as_json);

}  // namespace panofix
