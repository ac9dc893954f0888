#include "common/map/landmark_words.h"

#include <tbb/parallel_for.h>

#include "common/map/landmark_codes.h"

namespace panofix {

std::vector<std::uint32_t> WordsOfDescriptors(const VocabularyTree& sift,
                                              std::span<const std::uint8_t> rows,
                                              std::int64_t cols) {
  const auto width = static_cast<std::size_t>(cols);
  std::vector<std::uint32_t> words(rows.size() / width);
  tbb::parallel_for(std::size_t{0}, words.size(), [&](std::size_t i) {
    const std::uint8_t* row = &rows[i * width];
    std::uint8_t unpacked[kDescriptorSize];
    if (cols == kPackedDescriptorSize) {
      UnpackDescriptor(row, unpacked);
      row = unpacked;
    }
    words[i] = sift.Quantize(row);
  });
  return words;
}

}  // namespace panofix
