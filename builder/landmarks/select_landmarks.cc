#include "builder/landmarks/select_landmarks.h"

#include <tuple>
#include <unordered_map>

namespace panofix {
namespace {

// Best first; a landmark's place in the list settles ties.
std::vector<std::size_t> ByWorth(const std::vector<MergedLandmark>& landmarks) {
  std::vector<std::size_t> order(landmarks.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  const auto key = [&](std::size_t i) {
    const Landmark& landmark = landmarks[i].landmark;
    return std::make_tuple(-int{landmark.num_panoramas}, -static_cast<int>(landmark.views.size()),
                           -landmarks[i].response, i);
  };
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return key(a) < key(b); });
  return order;
}

}  // namespace

std::vector<Landmark> SelectLandmarks(std::vector<MergedLandmark> landmarks, int max_per_view) {
  std::vector<bool> is_kept(landmarks.size(), max_per_view == 0);
  if (max_per_view > 0) {
    std::unordered_map<std::uint32_t, int> count;  // looked up only, never walked
    for (const std::size_t i : ByWorth(landmarks)) {
      const auto& views = landmarks[i].landmark.views;
      is_kept[i] = std::any_of(views.begin(), views.end(),
                               [&](std::uint32_t view) { return count[view] < max_per_view; });
      if (!is_kept[i]) continue;
      for (const std::uint32_t view : views) ++count[view];
    }
  }
  std::vector<Landmark> kept;
  for (std::size_t i = 0; i < landmarks.size(); ++i) {
    if (is_kept[i]) kept.push_back(std::move(landmarks[i].landmark));
  }
  return kept;
}

}  // namespace panofix
