#pragma once
// Work file of a tile's similarity rows, by panorama id: it does not know the whole bundle.

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "builder/similarity/similarity_index.h"
#include "common/base/status.h"

namespace panofix {

// Row r: entries [offsets[r], offsets[r + 1]), most similar first.
struct SimilarityFile {
  std::vector<std::string> ids;          // of panoramas that entries name, ascending by first use
  std::vector<std::uint32_t> offsets;    // one row a view of the tile's panoramas
  std::vector<std::uint32_t> panoramas;  // into ids
  std::vector<std::uint32_t> views;      // of that panorama
  std::vector<float> similarity;
};

// `index` counts `per_panorama` views of each of `ids`. Throws Error.
void WriteSimilarityRows(const std::filesystem::path& path, const SimilarityIndex& index,
                         std::span<const std::string> ids, std::size_t per_panorama);
// kBadData or kNotFound.
[[nodiscard]] Result<SimilarityFile> ReadSimilarityRows(const std::filesystem::path& path);

}  // namespace panofix
