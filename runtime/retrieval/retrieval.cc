#include "runtime/retrieval/retrieval.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <unordered_map>

namespace panofix {
namespace {

// A search that is to end does so after so many tiles: some milliseconds.
constexpr std::size_t kTilesAtOnce = 16;

}  // namespace

Retrieval::Retrieval(std::shared_ptr<const MapBundle> bundle, const RetrievalOptions& options)
    : bundle_(std::move(bundle)),
      options_(options),
      tiles_(std::make_unique<TileIndices>(bundle_, options_.use_landmarks,
                                           options_.max_memory_bytes)) {}

template <typename Visit>
bool Retrieval::ForEachTile(const std::vector<char>& wanted, const std::function<bool()>& stop,
                            const Visit& visit) const {
  std::vector<std::size_t> batch;
  const auto visit_batch = [&] {
    if (batch.empty()) return;
    tbb::parallel_for(std::size_t{0}, batch.size(),
                      [&](std::size_t i) { visit(batch[i], *tiles_->Of(batch[i])); });
    batch.clear();
    tiles_->Trim();
  };
  // Where memory is bounded a tile may have to go before the next comes.
  const std::size_t most = options_.max_memory_bytes > 0 ? 1 : kTilesAtOnce;
  for (std::size_t tile = 0; tile < bundle_->tiles().size(); ++tile) {
    if (!wanted.empty()) {
      const std::vector<std::uint32_t>& views = bundle_->ViewsOfTile(tile);
      if (std::none_of(views.begin(), views.end(), [&](auto v) { return wanted[v] != 0; }))
        continue;
    } else if (stop && stop()) {
      return false;
    }
    batch.push_back(tile);
    if (batch.size() == most) visit_batch();
  }
  visit_batch();
  return true;
}

std::vector<float> Retrieval::Similarities(const RetrievalQuery& query,
                                           const std::vector<char>& wanted,
                                           std::vector<float>* landmark_votes) const {
  std::vector<float> scores(bundle_->views().size(), 0), votes(scores.size(), 0);
  static const FeatureSet kNobody;
  const Voters voters(bundle_->vocabulary(), options_.use_landmarks ? query.sift : kNobody,
                      query.bearings, query.camera, VoteOptions{});
  const bool is_whole =
      ForEachTile(wanted, query.stop, [&](std::size_t tile, const TileIndex& index) {
        const std::vector<float> by_words = index.words.Score(query.bag);
        const std::vector<std::uint32_t>& views = bundle_->ViewsOfTile(tile);
        for (std::size_t i = 0; i < views.size(); ++i) {
          if (wanted.empty() || wanted[views[i]] != 0) scores[views[i]] = by_words[i];
        }
        if (index.votes) index.votes->Score(voters, wanted, &votes);
      });
  if (!is_whole) return {};
  if (!options_.use_landmarks) return scores;
  // On generated towns votes alone rank the right place first in 72 % of the frames, words in 24 %.
  constexpr float kVotesShare = 0.8F;
  constexpr float kManyVotes = 2;  // as good as half of the range
  for (std::size_t v = 0; v < scores.size(); ++v)
    scores[v] = (1 - kVotesShare) * scores[v] + kVotesShare * votes[v] / (votes[v] + kManyVotes);
  if (landmark_votes != nullptr) *landmark_votes = std::move(votes);
  return scores;
}

RetrievalResult Retrieval::Best(const std::vector<float>& similarities) const {
  std::vector<RetrievedView> views;
  for (std::uint32_t v = 0; v < similarities.size(); ++v) {
    if (similarities[v] > 0) views.push_back({v, similarities[v]});
  }
  std::sort(views.begin(), views.end(), [](const RetrievedView& a, const RetrievedView& b) {
    return a.similarity > b.similarity || (a.similarity == b.similarity && a.view_idx < b.view_idx);
  });
  std::unordered_map<std::uint32_t, int> taken;
  RetrievalResult result;
  for (const RetrievedView& view : views) {
    if (static_cast<int>(result.views.size()) >= options_.num_views) break;
    int& count = taken[bundle_->views()[view.view_idx].panorama_idx];
    if (count++ < options_.max_views_per_panorama) result.views.push_back(view);
  }
  return result;
}

RetrievalResult Retrieval::Global(const RetrievalQuery& query,
                                  std::vector<float>* best_of_panorama) const {
  std::vector<float> votes;
  const std::vector<float> scores = Similarities(query, {}, &votes);
  RetrievalResult result = Best(scores);
  result.votes = std::move(votes);
  result.num_compared = static_cast<std::int64_t>(scores.size());
  if (best_of_panorama == nullptr || scores.empty()) return result;
  best_of_panorama->assign(bundle_->panoramas().size(), 0);
  for (std::size_t v = 0; v < scores.size(); ++v) {
    float& best = (*best_of_panorama)[bundle_->views()[v].panorama_idx];
    best = std::max(best, scores[v]);
  }
  return result;
}

RetrievalResult Retrieval::Windowed(const RetrievalQuery& query,
                                    std::span<const std::uint32_t> around,
                                    std::span<const std::uint32_t> places) const {
  std::vector<char> wanted(bundle_->views().size(), 0);
  const auto want = [&](std::uint32_t panorama) {
    std::fill(wanted.begin() + bundle_->first_station(panorama) * bundle_->views_per_station(),
              wanted.begin() + bundle_->first_station(panorama + 1) * bundle_->views_per_station(),
              1);
  };
  for (const std::uint32_t place : places) want(place);
  for (const std::uint32_t view : around) {
    want(bundle_->views()[view].panorama_idx);
    for (const std::uint32_t similar : bundle_->SimilarViews(view))
      want(bundle_->views()[similar].panorama_idx);
  }
  RetrievalResult result = Best(Similarities(query, wanted));
  result.num_compared = std::count(wanted.begin(), wanted.end(), 1);
  return result;
}

RetrievalResult Retrieval::InRows(const RetrievalQuery& query,
                                  std::span<const std::uint32_t> around, bool ranked) const {
  const std::uint32_t per_station = bundle_->views_per_station();
  std::vector<char> wanted(around.empty() ? 0 : bundle_->views().size(), 0);
  const auto want = [&](std::uint32_t view) {
    const std::uint32_t panorama = bundle_->views()[view].panorama_idx;
    for (std::uint32_t s = bundle_->first_station(panorama);
         s < bundle_->first_station(panorama + 1); ++s) {
      wanted[s * per_station + view % per_station] = 1;
    }
  };
  for (const std::uint32_t view : around) {
    want(view);
    for (const std::uint32_t similar : bundle_->SimilarViews(view)) want(similar);
  }
  const std::vector<float> scores = Similarities(query, wanted);
  RetrievalResult result = ranked ? Best(scores) : BestAndItsRow(scores);
  result.num_compared = around.empty() ? static_cast<std::int64_t>(scores.size())
                                       : std::count(wanted.begin(), wanted.end(), 1);
  return result;
}

RetrievalResult Retrieval::BestAndItsRow(const std::vector<float>& similarities) const {
  RetrievalResult result;
  const auto best = std::max_element(similarities.begin(), similarities.end());
  if (best == similarities.end() || !(*best > 0)) return result;
  const auto view = static_cast<std::uint32_t>(best - similarities.begin());
  result.views.push_back({view, *best});
  for (const std::uint32_t similar : bundle_->SimilarViews(view)) {
    if (static_cast<int>(result.views.size()) == options_.num_similar) break;
    result.views.push_back({similar, similarities[similar]});
  }
  return result;
}

std::vector<float> Retrieval::Votes(const FeatureSet& sift,
                                    std::span<const Eigen::Vector2d> bearings,
                                    const Camera& camera) const {
  if (!options_.use_landmarks) return {};
  std::vector<float> votes(bundle_->views().size(), 0);
  const Voters voters(bundle_->vocabulary(), sift, bearings, camera, VoteOptions{});
  ForEachTile({}, {}, [&](std::size_t, const TileIndex& index) {
    if (index.votes) index.votes->Score(voters, {}, &votes);
  });
  return votes;
}

}  // namespace panofix
