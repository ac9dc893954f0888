#pragma once
// Visual words of landmarks, from their descriptors as a bundle stores them.

#include <cstdint>
#include <span>
#include <vector>

#include "common/vocabulary/vocabulary.h"

namespace panofix {

// SIFT word of each row of stored descriptors: `cols` is kDescriptorSize, or
// kPackedDescriptorSize where they are packed. `sift` is the tree as it comes back from its file,
// not empty: then builder and runtime agree on every word. About 1 us a row; TBB over rows.
[[nodiscard]] std::vector<std::uint32_t> WordsOfDescriptors(const VocabularyTree& sift,
                                                            std::span<const std::uint8_t> rows,
                                                            std::int64_t cols);

}  // namespace panofix
