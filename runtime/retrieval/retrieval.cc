#include "runtime/retrieval/retrieval.h"

#include <algorithm>

namespace panofix {
namespace {

void KeepBest(std::vector<RetrievedView>* views, int count) {
  const auto better = [](const RetrievedView& a, const RetrievedView& b) {
    return a.similarity > b.similarity || (a.similarity == b.similarity && a.view_idx < b.view_idx);
  };
  const std::size_t keep = std::min(views->size(), static_cast<std::size_t>(std::max(0, count)));
  std::partial_sort(views->begin(), views->begin() + static_cast<std::ptrdiff_t>(keep),
                    views->end(), better);
  views->resize(keep);
}

}  // namespace

Retrieval::Retrieval(std::shared_ptr<const MapBundle> bundle)
    : bundle_(std::move(bundle)), index_(bundle_->bags(), bundle_->vocabulary().num_words()) {}

RetrievalResult Retrieval::Global(const BagOfWords& query, int count) const {
  const std::vector<float> scores = index_.Score(query);
  RetrievalResult result;
  result.num_compared = static_cast<std::int64_t>(scores.size());
  for (std::uint32_t v = 0; v < scores.size(); ++v) {
    if (scores[v] > 0) result.views.push_back({v, scores[v]});
  }
  KeepBest(&result.views, count);
  return result;
}

RetrievalResult Retrieval::Windowed(const BagOfWords& query, std::span<const std::uint32_t> around,
                                    int count) const {
  std::vector<std::uint32_t> candidates(around.begin(), around.end());
  for (const std::uint32_t view : around) {
    const auto row = bundle_->SimilarViews(view);
    candidates.insert(candidates.end(), row.begin(), row.end());
  }
  std::sort(candidates.begin(), candidates.end());
  candidates.erase(std::unique(candidates.begin(), candidates.end()), candidates.end());
  RetrievalResult result;
  result.num_compared = static_cast<std::int64_t>(candidates.size());
  for (const std::uint32_t view : candidates) {
    const float similarity = Similarity(query, bundle_->bags()[view]);
    if (similarity > 0) result.views.push_back({view, similarity});
  }
  KeepBest(&result.views, count);
  return result;
}

}  // namespace panofix
