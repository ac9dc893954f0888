#pragma once
// Which database views may show what the camera sees: bag-of-words search, global or windowed.

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "common/map/map_bundle.h"

namespace panofix {

struct RetrievedView {
  std::uint32_t view_idx = 0;
  float similarity = 0;  // cosine, [0, 1]
};

struct RetrievalResult {
  std::vector<RetrievedView> views;  // best first, equals by index
  std::int64_t num_compared = 0;     // views that were scored
};

// Immutable; thread-safe. Holds the inverted index of a bundle.
class Retrieval {
 public:
  explicit Retrieval(std::shared_ptr<const MapBundle> bundle);
  // The `count` most similar of all views.
  [[nodiscard]] RetrievalResult Global(const BagOfWords& query, int count) const;
  // The same among the union of the D_DB x r rows of `around`, and `around` itself (paper, section
  // III-B: an ordinary frame searches only there).
  [[nodiscard]] RetrievalResult Windowed(const BagOfWords& query,
                                         std::span<const std::uint32_t> around, int count) const;

 private:
  std::shared_ptr<const MapBundle> bundle_;
  InvertedIndex index_;
};

}  // namespace panofix
